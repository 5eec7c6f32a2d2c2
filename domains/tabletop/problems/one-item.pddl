; The spray bottle alone changes sides, as in the paper's Figure 1.
(define (problem one-item)
  (:domain tabletop)
  (:objects green-mug water-bottle soda-can spray-bottle - item
            blue white - section)
  (:init (robot-gripper-empty)
         (in-table-section green-mug white)
         (in-table-section water-bottle white)
         (in-table-section soda-can white)
         (in-table-section spray-bottle blue))
  (:goal (in-table-section spray-bottle white)))
