; Speaks a sentence to a file and prints its segments as flite_times.c does.
(define (umo_flag item feature)
  (let ((value (item.feat item feature)))
    (if (or (string-equal (format nil "%s" value) "0") (string-equal (format nil "%s" value) "")) 0 1)))
(define (umo_speak text stretch path)
  (Parameter.set 'Duration_Stretch stretch)
  (let ((utt (utt.synth (eval (list 'Utterance 'Text text)))) (word 0) (before nil))
    (utt.save.wave utt path 'riff)
    (mapcar
     (lambda (segment)
       (let ((id (item.feat segment "R:SylStructure.parent.parent.id")) (inside 0))
         (if (not (string-equal (format nil "%s" id) "0"))
             (begin
              (set! inside 1)
              (if (not (string-equal (format nil "%s" id) (format nil "%s" before)))
                  (begin (set! word (+ word 1)) (set! before id)))))
         (format t "%s\t%f\t%d\t%d\t%d\t%s\n"
                 (item.name segment) (item.feat segment "end")
                 (umo_flag segment "R:SylStructure.parent.stress")
                 (umo_flag segment "R:SylStructure.parent.accented")
                 (if (equal? inside 1) word 0)
                 (if (equal? inside 1) (item.feat segment "R:SylStructure.parent.parent.name") ""))))
     (utt.relation.items utt 'Segment))
    (format t "\n")))
