(define (problem random-3-0032)
  (:domain blocksworld)
  (:objects small-red-rubber-cylinder - cylinder
            large-gray-rubber-cube - cube
            large-purple-metal-sphere - sphere)
  (:init (on large-gray-rubber-cube small-red-rubber-cylinder)
         (on-table small-red-rubber-cylinder)
         (on-table large-purple-metal-sphere)
         (hand-empty))
  (:goal (and (on-table small-red-rubber-cylinder)
              (on-table large-gray-rubber-cube)
              (on-table large-purple-metal-sphere))))
