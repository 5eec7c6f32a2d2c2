; What is to be where it cannot be seen in the end.
(define (problem put-away)
  (:domain drawers)
  (:objects lemon can - item top middle - drawer worktop tray - surface)
  (:init (hand-empty))
  (:goal (and (at lemon top) (at can middle) (not (open top)) (not (open middle)))))
