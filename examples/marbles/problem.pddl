; Both marbles into the right cup.
(define (problem gather)
  (:domain marbles)
  (:objects red blue - marble
            left middle right - cup)
  (:init (free) (in red left) (in blue middle))
  (:goal (and (in red right) (in blue right))))
