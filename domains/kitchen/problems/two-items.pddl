; No more than the two things that are wanted, and nobody says where.
(define (problem fetch-two-of-two)
  (:domain kitchen)
  (:objects lemon can - item
            left-drawer middle-drawer right-drawer - drawer
            worktop tray - surface)
  (:init (hand-empty))
  (:goal (and (on lemon tray) (on can tray)
              (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))))
