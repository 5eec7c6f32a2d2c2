(define (problem breakfast)
  (:domain dishes)
  (:objects mug - cup
            saucer - plate
            table shelf - place)
  (:init (at mug shelf) (at saucer table) (same-size mug saucer) (not (served)))
  (:goal (and (served)
              (forall (?cup - cup) (at ?cup table))
              (not (clean saucer)))))
