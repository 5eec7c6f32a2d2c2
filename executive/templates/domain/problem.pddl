; The problem that is run unless --problem names another one: which things there are, how they start, what is wanted.
(define (problem clear-dark-table)
  (:domain my-domain)                            ; as in domain.pddl

  ; Every object needs a body of the same name in scene.toml: an [[item]] or a [[table]].
  (:objects red-block blue-tin - item
            dark-table light-table - table)

  ; Where things are put before the robot looks. It is not told: it has to see for itself. What is left out here is
  ; drawn by the run's --seed; here that is where on the table each of them stands.
  (:init (hand-empty)
         (on red-block dark-table)
         (on blue-tin dark-table))

  ; What has to be seen for the run to have reached its goal. The plan follows this order where it can.
  (:goal (and (on red-block light-table)
              (on blue-tin light-table))))
