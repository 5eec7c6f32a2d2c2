; Three blocks in four columns: the yellow one is dug out and put on the red one.
(define (problem dig-out)
  (:domain blocksworld)
  (:objects r y g - block
            c1 c2 c3 c4 - column)
  (:init (inColumn y c1) (inColumn g c1) (inColumn r c3)
         (on g y)
         (clear g) (clear r)
         (rightOf c2 c1) (rightOf c3 c2) (rightOf c4 c3)
         (leftOf c1 c2) (leftOf c2 c3) (leftOf c3 c4))
  (:goal (and (on y r) (inColumn r c3) (inColumn g c4) (clear g))))
