; The quickest one, for trying things out: executive run my-domain --problem one-block --estimator oracle
; A problem in this folder is named by its file. Items of the scene that it does not list are not there.
(define (problem one-block)
  (:domain my-domain)
  (:objects red-block - item
            dark-table light-table - table)
  (:init (hand-empty)
         (on red-block dark-table))
  (:goal (on red-block light-table)))
