(define (problem random-3-0025)
  (:domain blocksworld)
  (:objects small-brown-metal-sphere - sphere
            large-brown-rubber-cube - cube
            small-pink-rubber-cylinder - cylinder)
  (:init (on-table small-brown-metal-sphere)
         (on-table large-brown-rubber-cube)
         (on-table small-pink-rubber-cylinder)
         (hand-empty))
  (:goal (and (on large-brown-rubber-cube small-pink-rubber-cylinder)
              (on-table small-brown-metal-sphere)
              (on-table small-pink-rubber-cylinder))))
