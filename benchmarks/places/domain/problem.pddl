; Two things are wanted, of four; where they are is drawn by each setting of the benchmark.
(define (problem two-wanted)
  (:domain cabinet)
  (:objects lemon can salt cup - item left middle right - drawer worktop tray - surface)
  (:init (hand-empty) (= (weight left) 1) (= (weight middle) 1) (= (weight right) 1))
  (:goal (and (at lemon tray) (at can tray) (not (open left)) (not (open middle)) (not (open right))))
  (:metric minimize (total-cost)))
