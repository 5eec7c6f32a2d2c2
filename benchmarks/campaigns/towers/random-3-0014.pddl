(define (problem random-3-0014)
  (:domain blocksworld)
  (:objects small-blue-metal-sphere - sphere
            large-gray-metal-cylinder - cylinder
            large-pink-metal-cube - cube)
  (:init (on large-pink-metal-cube large-gray-metal-cylinder)
         (on-table small-blue-metal-sphere)
         (on-table large-gray-metal-cylinder)
         (hand-empty))
  (:goal (and (on small-blue-metal-sphere large-gray-metal-cylinder)
              (on-table large-gray-metal-cylinder)
              (on-table large-pink-metal-cube))))
