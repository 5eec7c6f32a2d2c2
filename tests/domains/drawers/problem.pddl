; Nobody says where the lemon and the can are.
(define (problem find-both)
  (:domain drawers)
  (:objects lemon can - item top middle bottom - drawer worktop tray - surface)
  (:init (hand-empty))
  (:goal (and (at lemon tray) (at can tray)
              (not (open top)) (not (open middle)) (not (open bottom)))))
