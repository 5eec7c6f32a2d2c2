; All four change sides.
(define (problem exchange)
  (:domain tabletop)
  (:objects green-mug water-bottle soda-can spray-bottle - item
            blue white - section)
  (:init (robot-gripper-empty)
         (in-table-section green-mug blue)
         (in-table-section water-bottle white)
         (in-table-section soda-can white)
         (in-table-section spray-bottle blue))
  (:goal (and (in-table-section green-mug white)
              (in-table-section water-bottle blue)
              (in-table-section soda-can blue)
              (in-table-section spray-bottle white))))
