; The words of this domain: which kinds of things there are, what can be true of them, and what can be done.
; Lines that begin with a semicolon are comments. Upper and lower case are the same in PDDL.
(define (domain my-domain)                       ; the name that the problems refer to
  (:requirements :strips :typing)                ; what of PDDL is used; also :negative-preconditions, :equality
  (:types item table)                            ; kinds of things; "block tin - item" would be two kinds of items

  ; What can be true of things. Each of these with each fitting thing is an atom, such as on(red-block,dark-table),
  ; and the robot asks itself about every atom at every look. domain.toml says what makes each true in the simulator,
  ; questions.toml how a model is asked about it.
  (:predicates
    (on ?item - item ?table - table)
    (holding ?item - item)
    (hand-empty))

  ; What can be done. Each action is carried out by a skill that domain.toml names, so its parameters have to be those
  ; that the skill takes: an item and a table for both of these.
  (:action pick-up
    :parameters (?item - item ?table - table)
    :precondition (and (on ?item ?table) (hand-empty))      ; what must hold before it
    :effect (and (holding ?item)                            ; what is true after it ...
                 (not (on ?item ?table))                    ; ... and what is not any more
                 (not (hand-empty))))

  (:action put-down
    :parameters (?item - item ?table - table)
    :precondition (holding ?item)
    :effect (and (on ?item ?table)
                 (hand-empty)
                 (not (holding ?item)))))
