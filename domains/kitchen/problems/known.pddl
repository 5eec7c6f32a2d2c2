; Everything is known: where each thing is, and that no drawer is open.
(define (problem fetch-two-known)
  (:domain kitchen)
  (:objects lemon can butter salt - item
            left-drawer middle-drawer right-drawer - drawer
            worktop tray - surface)
  (:init (hand-empty)
         (in lemon left-drawer) (in can right-drawer) (in butter right-drawer) (on salt worktop)
         (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))
  (:goal (and (on lemon tray) (on can tray)
              (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))))
