; Everything that a condition and an effect may be: who goes through a house and puts out the lights.
(define (domain house)
  (:requirements :adl :action-costs)
  (:types place thing - object
          room corridor - place
          lamp fan - thing)
  (:predicates
    (in ?thing - thing ?place - place)
    (here ?place - place)
    (door ?from ?to - place)
    (locked ?from ?to - place)
    (lit ?lamp - lamp)
    (spinning ?fan - fan)
    (dusty ?place - place)
    (dark ?place - place)
    (counted ?one ?other - lamp))
  (:functions (steps ?from ?to - place) (total-cost) - number)

  (:action go
    :parameters (?from ?to - place)
    :precondition (and (here ?from)
                       (or (door ?from ?to) (door ?to ?from))
                       (not (locked ?from ?to))
                       (imply (dark ?to) (exists (?lamp - lamp) (and (in ?lamp ?from) (lit ?lamp)))))
    :effect (and (here ?to) (not (here ?from))
                 (forall (?fan - fan) (when (and (in ?fan ?to) (spinning ?fan)) (not (dusty ?to))))
                 (increase (total-cost) (steps ?from ?to))))

  (:action switch
    :parameters (?lamp - lamp ?place - place)
    :precondition (and (here ?place) (in ?lamp ?place))
    :effect (and (when (lit ?lamp) (and (not (lit ?lamp)) (dark ?place)))
                 (when (not (lit ?lamp)) (and (lit ?lamp) (not (dark ?place))))
                 (increase (total-cost) 1)))

  (:action count-all
    :parameters ()
    :precondition (and (forall (?lamp - lamp) (not (lit ?lamp)))
                       (not (exists (?fan - fan ?place - place) (and (in ?fan ?place) (here ?place) (spinning ?fan)))))
    :effect (forall (?one ?other - lamp)
              (when (not (= ?one ?other)) (counted ?one ?other))))

  (:action lock-all
    :parameters (?place - place)
    :precondition (and (here ?place) (forall (?lamp - lamp) (imply (in ?lamp ?place) (not (lit ?lamp)))))
    :effect (forall (?other - place) (when (door ?place ?other) (and (locked ?place ?other) (locked ?other ?place)))))

  (:action blow
    :parameters (?fan - fan ?place - place)
    :precondition (and (here ?place) (in ?fan ?place))
    :effect (and (spinning ?fan) (not (spinning ?fan)) (dusty ?place))))
