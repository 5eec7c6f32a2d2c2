; The drawer has to be opened to see what is in it, and may stay open.
(define (problem is-it-there)
  (:domain drawers)
  (:objects lemon - item top - drawer worktop - surface)
  (:init (hand-empty) (at lemon top))
  (:goal (at lemon top)))
