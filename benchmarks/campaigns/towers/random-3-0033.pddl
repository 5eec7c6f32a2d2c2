(define (problem random-3-0033)
  (:domain blocksworld)
  (:objects small-gray-rubber-sphere - sphere
            large-purple-rubber-cube - cube
            small-brown-rubber-cylinder - cylinder)
  (:init (on small-brown-rubber-cylinder large-purple-rubber-cube)
         (on-table small-gray-rubber-sphere)
         (on-table large-purple-rubber-cube)
         (hand-empty))
  (:goal (and (on-table small-gray-rubber-sphere)
              (on-table large-purple-rubber-cube)
              (on-table small-brown-rubber-cylinder))))
