"""What constants are worth: ``python -m benchmarks.sensitivity``.

Each constant of the tests that decide which tracks are outliers and how many motions there are is
set to 2/3 and 3/2 of its value, and rows of `benchmarks.unseen` are run again. A constant whose
change by a half ruins a row is a defect of the method. Prints the table of docs/constants.md.
"""

from __future__ import annotations

import argparse
import ast
import importlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks import unseen_sequences
from benchmarks.data import data_folder
from benchmarks.unseen_rows import Plan, chosen

CHIMERAS = "mssegment.sampling.chimeras"
SPLIT_TEST = "mssegment.segmentation.consensus.split_test"
BORDER = "mssegment.segmentation.consensus.border"
MODEL_ORDER = "mssegment.segmentation.consensus.model_order"
PERSPECTIVE = "mssegment.geometry.projective_flats"
GROUP_TEST = "mssegment.segmentation.consensus.group_test"
WALK_TEST = "mssegment.segmentation.consensus.walk_test"
GROUPS = "mssegment.segmentation.consensus.groups"
ROWS = ("hopkins-single", "noise-walks", "two-bodies", "random-10")
FACTORS = (2 / 3, 3 / 2)


@dataclass(frozen=True)
class Constant:
    """A constant of a module, and where its value comes from."""

    module: str
    name: str
    source: str

    @property
    def value(self) -> float:
        """As the module has it."""
        return float(getattr(importlib.import_module(self.module), self.name))

    @property
    def meaning(self) -> str:
        """The first sentence of the string below the constant."""
        module = importlib.import_module(self.module)
        body = ast.parse(Path(str(module.__file__)).read_text()).body
        for statement, after in pairwise(body):
            if _assigns(statement, self.name) and isinstance(after, ast.Expr):
                return " ".join(str(ast.literal_eval(after.value)).split()).split(". ")[0]
        raise LookupError(f"{self.module}.{self.name} has no string below it that explains it")


def _assigns(statement: ast.stmt, name: str) -> bool:
    """Whether a statement assigns the name, alone or in a tuple."""
    if not isinstance(statement, ast.Assign):
        return False
    return any(isinstance(n, ast.Name) and n.id == name for n in ast.walk(statement.targets[0]))


CONSTANTS = (
    Constant(CHIMERAS, "FLATS_PER_TRACK", "enough for the quantile; more cost time"),
    Constant(CHIMERAS, "SEED_NEIGHBOURS", "chosen: sampling among neighbours, as NAPSAC does"),
    Constant(CHIMERAS, "TESTED_NEIGHBOURS", "chosen: a body is seen locally"),
    Constant(CHIMERAS, "GOOD_SHARE", "chosen: a body of 15 tracks has so many flats of its own"),
    Constant(CHIMERAS, "TAIL", "usual level of a test; the null hypothesis is sampled"),
    Constant(CHIMERAS, "WALK_RESIDUAL", "three standard deviations"),
    Constant(CHIMERAS, "LUCKY_WALKS", "usual level of a test; needed by `head` of Hopkins155"),
    Constant(CHIMERAS, "GOOD_TRACKS", "theory: breakdown point at 75 % outliers"),
    Constant(SPLIT_TEST, "FREEDOM", "the usual Student t of robust statistics"),
    Constant(SPLIT_TEST, "COMPONENTS", "theory: 3 affine dimensions, and those of perspective"),
    Constant(SPLIT_TEST, "NOISE_UNIT", "two standard deviations of the measured noise"),
    Constant(SPLIT_TEST, "LEAST_SPREAD", "a debt: chosen on Hopkins155"),
    Constant(
        SPLIT_TEST,
        "FEWEST_FOR_PERSPECTIVE",
        "chosen: a linear form for each frame fits the noise of a few tracks",
    ),
    Constant(PERSPECTIVE, "SETTLED", "well below the noise: at 0 the decisions are the same"),
    Constant(WALK_TEST, "SURROGATES", "enough for a mean"),
    Constant(GROUP_TEST, "MOVING", "theory: 1.4 for noise"),
    Constant(GROUP_TEST, "LEVEL", "a third of one in a hundred sequences of noise"),
    Constant(MODEL_ORDER, "DOUBT", "odds of 20 to 1, the usual level of a test"),
    Constant(MODEL_ORDER, "LEAST_SEPARATION", "a debt: chosen on random scenes and Hopkins155"),
    Constant(BORDER, "BORDER_NEIGHBOURS", "chosen: the usual neighbourhood"),
    Constant(BORDER, "BORDER_FRACTION", "chosen on Hopkins155"),
    Constant(GROUPS, "MIN_GROUP_SIZE", "theory: twice an elemental subset of 4 tracks"),
    Constant(GROUPS, "MIN_GROUP_SHARE", "a debt: chosen on Hopkins155"),
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a line for each constant as it is measured."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sensitivity",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the scenes (0)")
    parser.add_argument("--scenes", type=int, default=16, help="scenes of a row (16)")
    options = parser.parse_args(arguments)
    plan = Plan(range(options.seed, options.seed + 1), options.scenes, data_folder())
    print("| constant | value | meaning | source | " + " | ".join(ROWS) + " |")
    print("|---|---|---|---|" + "---|" * len(ROWS))
    print("| all as they are | | | | " + " | ".join(counts_right(plan)) + " |", flush=True)
    for constant in CONSTANTS:
        changed = []
        for factor in FACTORS:
            with scaled(constant, factor):
                changed.append(counts_right(plan))
        cells = [" / ".join(pair) for pair in zip(*changed, strict=True)]
        name = f"`{constant.module.rpartition('.')[2]}.{constant.name}`"
        print(
            f"| {name} | {constant.value:.4g} | {constant.meaning} | {constant.source} | "
            + " | ".join(cells)
            + " |",
            flush=True,
        )


@contextmanager
def scaled(constant: Constant, factor: float) -> Iterator[None]:
    """The constant times ``factor``, an integer rounded away from its value, for a while."""
    module: ModuleType = importlib.import_module(constant.module)
    value = getattr(module, constant.name)
    changed = value * factor
    if isinstance(value, int):
        changed = int(np.floor(changed) if factor < 1 else np.ceil(changed))
    setattr(module, constant.name, changed)
    try:
        yield
    finally:
        setattr(module, constant.name, value)


def counts_right(plan: Plan) -> list[str]:
    """Percentage of right numbers of motions in each row; empty where its data is not there."""
    found = []
    for row in chosen(unseen_sequences.ROWS, ROWS):
        outcomes = [] if row.missing(plan) else list(row.outcomes(plan))
        share = np.mean([outcome.count_right for outcome in outcomes]) if outcomes else None
        found.append("" if share is None else f"{100 * share:.0f}")
    return found


if __name__ == "__main__":
    main()
