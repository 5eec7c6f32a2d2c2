; Nobody says where lemon and can are: each is in a drawer or on the worktop, as often as [priors] in domain.toml says.
; Butter and salt have two places each.
(define (problem fetch-two)
  (:domain kitchen)
  (:objects lemon can butter salt - item
            left-drawer middle-drawer right-drawer - drawer
            worktop tray - surface)
  (:init (hand-empty)
         (oneof (in lemon left-drawer) (in lemon middle-drawer) (in lemon right-drawer) (on lemon worktop))
         (oneof (in can left-drawer) (in can middle-drawer) (in can right-drawer) (on can worktop))
         (oneof (in butter middle-drawer) (on butter worktop))
         (oneof (in salt left-drawer) (on salt worktop))
         (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))
  (:goal (and (on lemon tray) (on can tray)
              (not (open left-drawer)) (not (open middle-drawer)) (not (open right-drawer)))))
