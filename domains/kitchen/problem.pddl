; Nobody says where the things are: in a drawer, or on the worktop.
(define (problem fetch-two)
  (:domain kitchen)
  (:objects lemon can butter salt - item
            left-drawer middle-drawer right-drawer - drawer
            worktop tray - surface)
  (:init (hand-empty))
  (:goal (and (on lemon tray) (on can tray)
              (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))))
