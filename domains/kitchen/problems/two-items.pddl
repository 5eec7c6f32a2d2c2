; No more than the two things that are wanted; each is in one of the drawers or on the worktop, and nobody says where.
(define (problem fetch-two-of-two)
  (:domain kitchen)
  (:objects lemon can - item
            left-drawer middle-drawer right-drawer - drawer
            worktop tray - surface)
  (:init (hand-empty)
         (oneof (in lemon left-drawer) (in lemon middle-drawer) (in lemon right-drawer) (on lemon worktop))
         (oneof (in can left-drawer) (in can middle-drawer) (in can right-drawer) (on can worktop))
         (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))
  (:goal (and (on lemon tray) (on can tray)
              (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))))
