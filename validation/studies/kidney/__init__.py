"""Fig. 5 and Table I: the kidney, original, with linear and with Green strain."""

from palpate.validation.studies.of_case import findings_of, judge_live, page_of
from palpate.validation.studies.study import Study

STUDY = Study(
    "The kidney", __doc__, lambda progress: judge_live("kidney", progress), findings_of, page_of
)
