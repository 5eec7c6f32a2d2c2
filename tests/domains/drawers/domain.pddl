; A worktop with a tray, and drawers that hide what is in them while they are closed.
(define (domain drawers)
  (:requirements :strips :typing :negative-preconditions)
  (:types item place - object drawer surface - place)
  (:predicates
    (at ?item - item ?place - place)
    (open ?drawer - drawer)
    (holding ?item - item)
    (hand-empty))

  (:action pull
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (not (open ?drawer)))
    :effect (open ?drawer))
  (:action push
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (open ?drawer))
    :effect (not (open ?drawer)))
  (:action take-out
    :parameters (?item - item ?drawer - drawer)
    :precondition (and (hand-empty) (at ?item ?drawer) (open ?drawer))
    :effect (and (holding ?item) (not (at ?item ?drawer)) (not (hand-empty))))
  (:action take
    :parameters (?item - item ?surface - surface)
    :precondition (and (hand-empty) (at ?item ?surface))
    :effect (and (holding ?item) (not (at ?item ?surface)) (not (hand-empty))))
  (:action put-in
    :parameters (?item - item ?drawer - drawer)
    :precondition (and (holding ?item) (open ?drawer))
    :effect (and (at ?item ?drawer) (hand-empty) (not (holding ?item))))
  (:action put-on
    :parameters (?item - item ?surface - surface)
    :precondition (holding ?item)
    :effect (and (at ?item ?surface) (hand-empty) (not (holding ?item)))))
