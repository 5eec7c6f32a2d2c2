; Both cubes start on the bench and end in the tray, the green one first.
(define (problem fill-tray)
  (:domain tray)
  (:objects red-cube green-cube - cube
            bench - bench)
  (:init (hand-free)
         (resting-on red-cube bench)
         (resting-on green-cube bench))
  (:goal (and (resting-on green-cube tray)
              (resting-on red-cube tray))))
