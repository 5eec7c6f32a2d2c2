; Two blocks, a table and one hand.
(define (domain robosuite_panda)
  (:requirements :strips :typing)
  (:types block)
  (:predicates
    (on-table ?block - block)
    (on ?block - block ?below - block)
    (clear ?block - block)
    (held ?block - block)
    (free))

  (:action take
    :parameters (?block - block)
    :precondition (and (on-table ?block) (clear ?block) (free))
    :effect (and (held ?block) (not (on-table ?block)) (not (free))))

  (:action stack
    :parameters (?block - block ?below - block)
    :precondition (and (held ?block) (clear ?below))
    :effect (and (on ?block ?below) (free) (not (held ?block)) (not (clear ?below)))))
