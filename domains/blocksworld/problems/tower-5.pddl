; A tower of five, among two blocks that are in its way.
(define (problem tower-5)
  (:domain blocksworld)
  (:objects large-blue-rubber-cube large-green-metal-cube small-red-metal-cube - cube
            large-purple-rubber-cylinder small-yellow-rubber-cylinder - cylinder
            small-cyan-metal-sphere large-gray-rubber-sphere - sphere)
  (:init (hand-empty)
         (on-table large-blue-rubber-cube)
         (on-table large-green-metal-cube)
         (on-table large-purple-rubber-cylinder)
         (on-table small-red-metal-cube)
         (on-table large-gray-rubber-sphere)
         (on small-yellow-rubber-cylinder small-red-metal-cube)
         (on small-cyan-metal-sphere small-yellow-rubber-cylinder))
  (:goal (and (on-table large-blue-rubber-cube)
              (on large-green-metal-cube large-blue-rubber-cube)
              (on large-purple-rubber-cylinder large-green-metal-cube)
              (on small-red-metal-cube large-purple-rubber-cylinder)
              (on small-yellow-rubber-cylinder small-red-metal-cube))))
