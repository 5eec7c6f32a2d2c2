(define (problem random-3-0019)
  (:domain blocksworld)
  (:objects large-gray-metal-sphere - sphere
            small-blue-rubber-cylinder - cylinder
            large-gray-metal-cube - cube)
  (:init (on-table large-gray-metal-sphere)
         (on-table small-blue-rubber-cylinder)
         (on-table large-gray-metal-cube)
         (hand-empty))
  (:goal (and (on large-gray-metal-cube small-blue-rubber-cylinder)
              (on-table large-gray-metal-sphere)
              (on-table small-blue-rubber-cylinder))))
