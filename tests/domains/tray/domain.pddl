; The smallest domain that is not about groceries: cubes from the bench into the tray.
(define (domain tray)
  (:requirements :strips :typing)
  (:types cube support - object
          bench tray - support)
  (:constants tray - tray)
  (:predicates
    (resting-on ?cube - cube ?support - support)
    (holding ?cube - cube)
    (hand-free))

  (:action lift
    :parameters (?cube - cube ?support - support)
    :precondition (and (resting-on ?cube ?support) (hand-free))
    :effect (and (holding ?cube)
                 (not (resting-on ?cube ?support))
                 (not (hand-free))))

  (:action drop
    :parameters (?cube - cube ?support - support)
    :precondition (holding ?cube)
    :effect (and (resting-on ?cube ?support)
                 (hand-free)
                 (not (holding ?cube)))))
