; Each can goes to the next table.
(define (problem rotate)
  (:domain cans)
  (:objects can-a can-b can-c - can
            left-table middle-table right-table - table)
  (:init (hand-empty)
         (on can-a left-table)
         (on can-b middle-table)
         (on can-c right-table))
  (:goal (and (on can-a middle-table)
              (on can-b right-table)
              (on can-c left-table))))
