"""Write the store of the study anew: minutes."""

from calibration_recipe.drawn import draw_problems, find_missing, write_store
from palpate.validation.studies.calibration import STORE

find_missing()
write_store(STORE, draw_problems())
