; Three cans that nothing tells apart, and three tables: which can is where has to be kept track of.
(define (domain cans)
  (:requirements :strips :typing)
  (:types can table)
  (:predicates
    (on ?can - can ?table - table)
    (in-hand ?can - can)
    (hand-empty))

  (:action pick
    :parameters (?can - can ?table - table)
    :precondition (and (on ?can ?table) (hand-empty))
    :effect (and (in-hand ?can)
                 (not (on ?can ?table))
                 (not (hand-empty))))

  (:action place
    :parameters (?can - can ?table - table)
    :precondition (in-hand ?can)
    :effect (and (on ?can ?table)
                 (hand-empty)
                 (not (in-hand ?can)))))
