; robosuite's task Stack: the small red block on the green one.
(define (problem stack)
  (:domain robosuite_panda)
  (:objects red green - block)
  (:init (on-table red) (on-table green) (clear red) (clear green) (free))
  (:goal (on red green)))
