; A worktop with a tray, and drawers that hide what is in them while they are closed.
(define (domain kitchen)
  (:requirements :strips :typing :negative-preconditions)
  (:types item drawer surface - object)
  (:predicates
    (in ?item - item ?drawer - drawer)
    (on ?item - item ?surface - surface)
    (open ?drawer - drawer)
    (holding ?item - item)
    (hand-empty))

  (:action open-drawer
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (not (open ?drawer)))
    :effect (open ?drawer))

  (:action close-drawer
    :parameters (?drawer - drawer)
    :precondition (and (hand-empty) (open ?drawer))
    :effect (not (open ?drawer)))

  (:action take-out
    :parameters (?item - item ?drawer - drawer)
    :precondition (and (hand-empty) (open ?drawer) (in ?item ?drawer))
    :effect (and (holding ?item) (not (in ?item ?drawer)) (not (hand-empty))))

  (:action pick-up
    :parameters (?item - item ?surface - surface)
    :precondition (and (hand-empty) (on ?item ?surface))
    :effect (and (holding ?item) (not (on ?item ?surface)) (not (hand-empty))))

  (:action put-in
    :parameters (?item - item ?drawer - drawer)
    :precondition (and (holding ?item) (open ?drawer))
    :effect (and (in ?item ?drawer) (hand-empty) (not (holding ?item))))

  (:action put-on
    :parameters (?item - item ?surface - surface)
    :precondition (holding ?item)
    :effect (and (on ?item ?surface) (hand-empty) (not (holding ?item)))))
