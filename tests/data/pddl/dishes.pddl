; Everything that the reader understands at once: subtypes, a constant, no parameters, no preconditions, = and forall
; in conditions and effects, negative preconditions.
(define (domain dishes)
  (:requirements :adl)
  (:types cup plate - dish
          dish place - object)
  (:constants sink - place)
  (:predicates
    (at ?dish - dish ?place - place)
    (clean ?dish - dish)
    (same-size ?a ?b - dish)
    (served))

  (:action move
    :parameters (?dish - dish ?from ?to - place)
    :precondition (and (at ?dish ?from) (not (= ?from ?to)) (not (served)))
    :effect (and (not (at ?dish ?from)) (at ?dish ?to)))

  (:action wash
    :parameters (?dish - dish)
    :precondition (and (at ?dish sink) (not (clean ?dish)))
    :effect (clean ?dish))

  (:action swap
    :parameters (?a ?b - dish ?here ?there - place)
    :precondition (and (at ?a ?here) (at ?b ?there) (same-size ?a ?b) (not (= ?a ?b)) (not (= ?here ?there)))
    :effect (and (at ?a ?there) (at ?b ?here) (not (at ?a ?here)) (not (at ?b ?there))))

  (:action serve
    :parameters ()
    :precondition (and (not (served)) (forall (?cup - cup) (and (clean ?cup) (not (at ?cup sink)))))
    :effect (served))

  (:action clear-away
    :parameters ()
    :effect (and (not (served)) (forall (?dish - dish ?place - place) (not (at ?dish ?place)))
                 (forall (?dish - dish) (and (at ?dish sink) (not (clean ?dish)))))))
