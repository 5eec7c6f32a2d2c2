; Two of the four change sides. Where in its section each item stands is drawn by the run's seed.
(define (problem swap)
  (:domain tabletop)
  (:objects green-mug water-bottle soda-can spray-bottle - item
            blue white - section)
  (:init (robot-gripper-empty)
         (in-table-section green-mug white)
         (in-table-section water-bottle white)
         (in-table-section soda-can blue)
         (in-table-section spray-bottle blue))
  (:goal (and (in-table-section green-mug white)
              (in-table-section water-bottle blue)
              (in-table-section soda-can blue)
              (in-table-section spray-bottle white))))
