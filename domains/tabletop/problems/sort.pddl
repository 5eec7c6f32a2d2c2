; What one drinks from goes into the blue section, the cleaner into the white one. Where they are is to be seen.
(define (problem sort)
  (:domain tabletop)
  (:objects green-mug water-bottle soda-can spray-bottle - item
            blue white - section)
  (:init (robot-gripper-empty))
  (:goal (and (in-table-section green-mug blue)
              (in-table-section water-bottle blue)
              (in-table-section soda-can blue)
              (in-table-section spray-bottle white))))
