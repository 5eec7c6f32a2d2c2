(define (problem random-3-0022)
  (:domain blocksworld)
  (:objects small-gray-rubber-sphere - sphere
            small-red-rubber-cube - cube
            small-cyan-metal-cylinder - cylinder)
  (:init (on small-gray-rubber-sphere small-red-rubber-cube)
         (on small-red-rubber-cube small-cyan-metal-cylinder)
         (on-table small-cyan-metal-cylinder)
         (hand-empty))
  (:goal (and (on-table small-gray-rubber-sphere)
              (on-table small-red-rubber-cube)
              (on-table small-cyan-metal-cylinder))))
