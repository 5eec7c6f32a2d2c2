; Blocks that an arm stacks, as in the S3E paper's Appendix C: cubes, cylinders and spheres, of which no sphere carries anything.
(define (domain blocksworld)
  (:requirements :strips :typing :equality :derived-predicates :negative-preconditions :existential-preconditions)
  (:types flat sphere - block
          cube cylinder - flat)
  (:predicates
    (on ?above - block ?below - flat)
    (on-table ?block - block)
    (clear ?block - block)
    (holding ?block - block)
    (hand-empty))

  (:derived (clear ?block - block)
    (not (exists (?other - block) (on ?other ?block))))

  (:action pick-up
    :parameters (?block - block)
    :precondition (and (on-table ?block) (clear ?block) (hand-empty))
    :effect (and (holding ?block) (not (on-table ?block)) (not (hand-empty))))

  (:action put-down
    :parameters (?block - block)
    :precondition (holding ?block)
    :effect (and (on-table ?block) (hand-empty) (not (holding ?block))))

  (:action stack
    :parameters (?block - block ?below - flat)
    :precondition (and (holding ?block) (clear ?below) (not (= ?block ?below)))
    :effect (and (on ?block ?below) (hand-empty) (not (holding ?block))))

  (:action unstack
    :parameters (?block - block ?below - flat)
    :precondition (and (on ?block ?below) (clear ?block) (hand-empty))
    :effect (and (holding ?block) (not (on ?block ?below)) (not (hand-empty)))))
