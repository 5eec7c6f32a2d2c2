; All six blocks and five columns: what a model for this scene is trained on.
(define (problem all-blocks)
  (:domain blocksworld)
  (:objects r g b y p o - block
            c1 c2 c3 c4 c5 - column)
  (:init (inColumn r c1) (inColumn g c2) (inColumn b c3) (inColumn y c4) (inColumn p c5) (inColumn o c5)
         (on o p)
         (clear r) (clear g) (clear b) (clear y) (clear o)
         (rightOf c2 c1) (rightOf c3 c2) (rightOf c4 c3) (rightOf c5 c4)
         (leftOf c1 c2) (leftOf c2 c3) (leftOf c3 c4) (leftOf c4 c5))
  (:goal (and (on r g) (inColumn r c2) (on y r))))
