"""The law of a case: read, refused, written out for others, and posed by those who can."""

import dataclasses
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from case_texts import OGDEN, RIVLIN

from palpate.fastsim.statics import solve_static
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Material, Strain
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.validation.candidates.outside import NOT_POSED
from palpate.validation.case import load_case
from palpate.validation.exchange.case_folder import case_key, write_case_folder
from palpate.validation.peers import adapters

CASES = Path(__file__).parents[3] / "validation" / "cases"
ADAPTERS = Path(adapters.__file__).parent
MODULI = "youngs_modulus = 10.0\npoissons_ratio = 0.3\n"


def case_of(folder, material):
    text = (CASES / "stretch.toml").read_text(encoding="utf-8")
    assert MODULI in text
    shutil.copy(CASES / "stretch.vtu", folder)
    path = folder / "law.toml"
    path.write_text(text.replace(MODULI, material), encoding="utf-8")
    return path


def test_mooney_and_rivlins_constants_are_those_of_the_case(tmp_path):
    material = load_case(case_of(tmp_path, RIVLIN)).problem.material
    mu, kappa = 3000.0, 10000.0
    assert (material.law, material.c01) == (Law.MOONEY_RIVLIN, 500.0)
    E = 9 * kappa * mu / (3 * kappa + mu)
    assert material.youngs_modulus == pytest.approx(E, rel=1e-14)
    assert E / (2 * (1 + material.poissons_ratio)) == pytest.approx(mu, rel=1e-14)


def test_ogdens_constants_are_those_of_the_case(tmp_path):
    text = OGDEN + "mu_2 = -0.5\nalpha_2 = -2.0\n"
    problem = load_case(case_of(tmp_path, text)).problem
    material = problem.material
    # mu = (2000 * 1.5 + 500 * 2) / 2 Pa.
    mu = material.youngs_modulus / (2 * (1 + material.poissons_ratio))
    assert mu == pytest.approx(2000.0, rel=1e-13)
    assert material.ogden_terms == ((0.75, 1.5), (0.25, -2.0))
    save_problem(tmp_path / "problem.npz", problem)
    assert load_problem(tmp_path / "problem.npz").material == material
    one = Material.ogden([(3000.0, 2.0)], bulk_modulus=1e4)
    some = Inclusion(np.array([0]), dataclasses.replace(one, density=2000.0))
    with pytest.raises(InputError, match="have their body's exponents"):
        dataclasses.replace(problem, inclusions=(some,))


def test_nonsense_is_refused_in_python():
    with pytest.raises(InputError, match="law = 'rubber' is not known"):
        Material(1e4, 0.3, law="rubber")
    with pytest.raises(InputError, match="c01 goes with"):
        Material(1e4, 0.3, law=Law.NEO_HOOKEAN, c01=1.0)


def test_a_law_is_part_of_a_problems_file_and_key_and_the_usual_one_is_not(tmp_path):
    plain = load_case("stretch").problem
    rubber = load_case(case_of(tmp_path, RIVLIN)).problem
    save_problem(tmp_path / "problem.npz", rubber)
    assert load_problem(tmp_path / "problem.npz").material == rubber.material
    of = load_case(case_of(tmp_path, MODULI + 'law = "neo-hookean"\n')).problem
    named = load_case(case_of(tmp_path, MODULI + 'law = "saint-venant-kirchhoff"\n')).problem
    keys = [case_key(problem, Strain.GREEN) for problem in (plain, named, of, rubber)]
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


@pytest.mark.parametrize(
    "law", [law for law in Law if not (law.is_linear_in_strain or law.is_of_stretches)]
)
def test_the_words_of_case_json_are_the_law(tmp_path, law):
    """Energy and stress as they stand there, worked out from the words and arrays alone."""
    text = MODULI + f'law = "{law}"\n'
    if law.has_c01:
        text = RIVLIN.replace("mooney-rivlin", law)
    problem = load_case(case_of(tmp_path, text)).problem
    write_case_folder(tmp_path / "out", problem, Strain.GREEN, name="law")
    case = json.loads((tmp_path / "out" / "case.json").read_text(encoding="utf-8"))
    with np.load(tmp_path / "out" / "rest.npz") as rest:
        E, nu = float(rest["youngs_modulus"][0]), float(rest["poissons_ratio"][0])
        c01 = float(rest["c01"][0]) if "c01" in rest.files else 0.0
    assert case["material"]["law"] == law
    assert "smoothed_element" not in case["conventions"]
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    words = case["law"].split("W = ")[1].split(", ")[0], case["conventions"]["internal_force"]
    F = np.eye(3) + 0.2 * np.random.default_rng(1).standard_normal((3, 3))

    def constants(F):
        J, C = np.linalg.det(F), F.T @ F
        one = np.trace(C)
        return {
            "mu": mu, "lmbda": lmbda, "L": lmbda + mu, "kappa": lmbda + 2 / 3 * mu,
            "c10": mu / 2 - c01, "c01": c01, "J": J, "I": one, "F": F, "C": C,
            "II": (one**2 - np.trace(C @ C)) / 2, "lnJ": np.log(J), "inverse": np.linalg.inv(F).T,
            "m": 4 / 3 * mu, "l": lmbda + 5 / 6 * mu, "ln": np.log,
        }  # fmt: skip

    def value(words, F):
        text = words.replace("F^-T", "inverse").replace("ln J", "lnJ").replace("^", "**")
        text = text.replace("F C", "F @ C").replace("(lnJ)", "lnJ")
        # A product is written as a space.
        for _ in range(2):
            text = re.sub(r"([\w)]) (?=[\w(])", r"\1 * ", text)
        return eval(text, {}, constants(F))  # words of ours

    energy, stress = words[0], words[1].split("P = dW/dF = ")[1]
    h, found = 1e-6, value(stress, F)
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = h
            slope = (value(energy, F + step) - value(energy, F - step)) / (2 * h)
            assert found[i, j] == pytest.approx(slope, abs=1e-6 * np.abs(found).max())


def posed(adapter, folder, text):
    path = case_of(folder, text)
    problem = load_case(path).problem
    write_case_folder(folder / "out", problem, Strain.GREEN, name="law")
    command = [sys.executable, str(ADAPTERS / adapter), folder / "out", folder / "result.npz"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done, problem


@pytest.mark.parametrize(
    ("adapter", "law", "limit"),
    [
        ("calculix.py", "neo-hookean-isochoric", 1e-6),  # seven digits in a text file
        ("calculix.py", "mooney-rivlin", 1e-6),
        ("felupe_svk.py", "neo-hookean", 1e-9),
        ("felupe_svk.py", "neo-hookean-isochoric", 1e-9),
    ],
)
def test_rivals_that_know_a_law_agree_on_it(tmp_path, adapter, law, limit):
    if adapter == "calculix.py" and not shutil.which("ccx"):
        pytest.skip("ccx is not installed")
    if adapter == "felupe_svk.py":
        pytest.importorskip("felupe")
    text = RIVLIN if law == "mooney-rivlin" else MODULI + f'law = "{law}"\n'
    done, problem = posed(adapter, tmp_path, text)
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "result.npz") as solution:
        u, about = solution["displacement"], json.loads(str(solution["about"]))
    assert about["law"] == law
    ours = solve_static(problem).displacement
    assert np.abs(u - ours).max() < limit * np.abs(ours).max()


@pytest.mark.parametrize("adapter", ["calculix.py", "numpy_dense.py"])
def test_who_cannot_pose_a_law_says_so(tmp_path, adapter):
    if adapter == "calculix.py" and not shutil.which("ccx"):
        pytest.skip("ccx is not installed")
    done, _ = posed(adapter, tmp_path, MODULI + 'law = "neo-hookean"\n')
    assert done.returncode == NOT_POSED
    assert "law neo-hookean" in done.stdout
