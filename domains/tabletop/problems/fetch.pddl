; The robot already holds the mug, and has one more item to move after it.
(define (problem fetch)
  (:domain tabletop)
  (:objects green-mug water-bottle soda-can spray-bottle - item
            blue white - section)
  (:init (robot-gripping green-mug)
         (in-table-section water-bottle blue)
         (in-table-section soda-can white)
         (in-table-section spray-bottle blue))
  (:goal (and (in-table-section green-mug blue)
              (in-table-section soda-can blue))))
