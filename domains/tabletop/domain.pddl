; Moving things between the two sections of one table, as in Experiment 2 of the S3E paper.
(define (domain tabletop)
  (:requirements :strips :typing)
  (:types item section)
  (:predicates
    (in-table-section ?item - item ?section - section)
    (robot-gripping ?item - item)
    (robot-gripper-empty))

  (:action pick
    :parameters (?item - item ?section - section)
    :precondition (and (in-table-section ?item ?section) (robot-gripper-empty))
    :effect (and (robot-gripping ?item)
                 (not (in-table-section ?item ?section))
                 (not (robot-gripper-empty))))

  (:action place
    :parameters (?item - item ?section - section)
    :precondition (robot-gripping ?item)
    :effect (and (in-table-section ?item ?section)
                 (robot-gripper-empty)
                 (not (robot-gripping ?item)))))
