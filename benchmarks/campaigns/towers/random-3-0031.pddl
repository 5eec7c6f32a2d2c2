(define (problem random-3-0031)
  (:domain blocksworld)
  (:objects large-cyan-metal-cube - cube
            small-gray-metal-sphere - sphere
            small-orange-metal-cylinder - cylinder)
  (:init (on large-cyan-metal-cube small-orange-metal-cylinder)
         (on small-gray-metal-sphere large-cyan-metal-cube)
         (on-table small-orange-metal-cylinder)
         (hand-empty))
  (:goal (and (on small-gray-metal-sphere small-orange-metal-cylinder)
              (on-table large-cyan-metal-cube)
              (on-table small-orange-metal-cylinder))))
