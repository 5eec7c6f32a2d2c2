; Drawers that hide what is in them while they are closed, and are of different weight.
(define (domain cabinet)
  (:requirements :strips :typing :negative-preconditions :action-costs)
  (:types item place - object drawer surface - place)
  (:predicates
    (at ?item - item ?place - place)
    (open ?drawer - drawer)
    (holding ?item - item)
    (hand-empty))
  (:functions (total-cost) (weight ?drawer - drawer))

  (:action pull
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (not (open ?drawer)))
    :effect (and (open ?drawer) (increase (total-cost) (weight ?drawer))))
  (:action push
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (open ?drawer))
    :effect (and (not (open ?drawer)) (increase (total-cost) 1)))
  (:action take
    :parameters (?item - item ?surface - surface)
    :precondition (and (hand-empty) (at ?item ?surface))
    :effect (and (holding ?item) (not (at ?item ?surface)) (not (hand-empty)) (increase (total-cost) 1)))
  (:action take-out
    :parameters (?item - item ?drawer - drawer)
    :precondition (and (hand-empty) (at ?item ?drawer) (open ?drawer))
    :effect (and (holding ?item) (not (at ?item ?drawer)) (not (hand-empty)) (increase (total-cost) 1)))
  (:action put-on
    :parameters (?item - item ?surface - surface)
    :precondition (holding ?item)
    :effect (and (at ?item ?surface) (hand-empty) (not (holding ?item)) (increase (total-cost) 1))))
