; Three blocks become a tower of three.
(define (problem tower-3)
  (:domain blocksworld)
  (:objects large-blue-rubber-cube small-red-metal-cube - cube
            small-yellow-rubber-cylinder - cylinder)
  (:init (hand-empty)
         (on-table large-blue-rubber-cube)
         (on-table small-red-metal-cube)
         (on-table small-yellow-rubber-cylinder))
  (:goal (and (on-table large-blue-rubber-cube)
              (on small-red-metal-cube large-blue-rubber-cube)
              (on small-yellow-rubber-cylinder small-red-metal-cube))))
