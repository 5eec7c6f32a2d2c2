; Marbles in cups, and a hand on a rail above them.
(define (domain marbles)
  (:requirements :strips :typing)
  (:types marble cup)
  (:predicates
    (in ?marble - marble ?cup - cup)
    (held ?marble - marble)
    (free))

  (:action take
    :parameters (?marble - marble ?cup - cup)
    :precondition (and (in ?marble ?cup) (free))
    :effect (and (held ?marble) (not (in ?marble ?cup)) (not (free))))

  (:action put
    :parameters (?marble - marble ?cup - cup)
    :precondition (held ?marble)
    :effect (and (in ?marble ?cup) (free) (not (held ?marble)))))
