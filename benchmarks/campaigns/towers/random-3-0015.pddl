(define (problem random-3-0015)
  (:domain blocksworld)
  (:objects small-purple-metal-cylinder - cylinder
            large-orange-metal-sphere - sphere
            small-red-metal-cube - cube)
  (:init (on small-purple-metal-cylinder small-red-metal-cube)
         (on-table large-orange-metal-sphere)
         (on-table small-red-metal-cube)
         (hand-empty))
  (:goal (and (on large-orange-metal-sphere small-red-metal-cube)
              (on-table small-purple-metal-cylinder)
              (on-table small-red-metal-cube))))
