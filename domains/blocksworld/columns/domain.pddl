; Blocks in columns, in the vocabulary of ViPlan's blocksworld, so that its problems can be played: `--problem FILE`.
; Each column is a place on the table; a move takes a block that nothing stands on to the top of another column.
(define (domain blocksworld)
  (:requirements :strips :typing :negative-preconditions :conditional-effects :equality)
  (:types block column)
  (:predicates
    (on ?b1 - block ?b2 - block)
    (inColumn ?b - block ?c - column)
    (clear ?b - block)
    (rightOf ?c1 - column ?c2 - column)
    (leftOf ?c1 - column ?c2 - column))

  (:action moveBlock
    :parameters (?b1 - block ?c1 - column)
    :precondition (and (clear ?b1) (not (inColumn ?b1 ?c1)))
    :effect (and
      (inColumn ?b1 ?c1)
      (forall (?from - column)
        (when (inColumn ?b1 ?from) (not (inColumn ?b1 ?from))))
      (forall (?below - block)
        (when (on ?b1 ?below) (and (not (on ?b1 ?below)) (clear ?below))))
      (forall (?top - block)
        (when (and (clear ?top) (inColumn ?top ?c1) (not (= ?top ?b1)))
          (and (on ?b1 ?top) (not (clear ?top))))))))
