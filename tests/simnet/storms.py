"""Any number of storms on all cores (`make storms SEEDS=10000`), or one again, cut down (`make storms SEED=17`)."""

from __future__ import annotations

import argparse
import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

from simnet.checkers import violations
from simnet.plan import Plan, plan_of
from simnet.storm import ALL_REAL, Storm

TOLD_S = 10.0
CHUNK = 5


class Outcome(NamedTuple):
    """One storm's."""

    seed: int
    wrong: list[str]
    heal_to_quiet_ms: int


def play(plan: Plan) -> Outcome:
    """A crash of the storm itself is a fault like any other."""
    try:
        history = Storm(plan, ALL_REAL).run()
        return Outcome(plan.seed, list(violations(history)), history.heal_to_quiet_ms)
    except Exception:  # whatever it is, it has a seed
        return Outcome(plan.seed, [traceback.format_exc(limit=-3)], 0)


def play_seed(seed: int) -> Outcome:
    return play(plan_of(seed))


def cut_down(plan: Plan) -> Plan:
    """The plan without what it does not need to fail the same invariant."""
    kind = play(plan).wrong[0][:3]
    for smaller in plan.without_one():
        if any(text.startswith(kind) for text in play(smaller).wrong):
            return cut_down(smaller)
    return plan


def again(seed: int) -> int:
    """Play one storm, and if it fails, show the least of its faults that still does."""
    wrong = play_seed(seed).wrong
    print(f"storm {seed}: {len(wrong)} violations", *wrong[:20], sep="\n  ")
    if wrong:
        plan = cut_down(plan_of(seed))
        print("  the least that brings it about:")
        for field in fields(plan):
            values = getattr(plan, field.name)
            for value in values if isinstance(values, tuple) else (values,):
                print(f"    {field.name}: {value}")
    return 1 if wrong else 0


def outcomes(seeds: int) -> Iterator[Outcome]:
    """As they come, from one process per core; the workers inherit that Ctrl-C is not for them."""
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    with multiprocessing.get_context("spawn").Pool() as pool:
        signal.signal(signal.SIGINT, handler)
        yield from pool.imap_unordered(play_seed, range(seeds), chunksize=CHUNK)


def many(seeds: int) -> int:
    """Play storms 0 to `seeds` - 1; each that fails is told at once, with the command that plays it again."""
    begin_s = told_s = time.monotonic()
    done, failed, slowest_ms = 0, 0, 0
    try:
        for outcome in outcomes(seeds):
            done, failed = done + 1, failed + bool(outcome.wrong)
            slowest_ms = max(slowest_ms, outcome.heal_to_quiet_ms)
            if outcome.wrong:
                print(
                    f"storm {outcome.seed} failed; again: make storms SEED={outcome.seed}",
                    *outcome.wrong[:3],
                    sep="\n  ",
                    flush=True,
                )
            if time.monotonic() - told_s > TOLD_S:
                told_s = time.monotonic()
                print(
                    f"{done} of {seeds} storms, {failed} failed, {done / (told_s - begin_s):.0f} a second", flush=True
                )
    except KeyboardInterrupt:
        print("stopped")
    told = f"{done} of {seeds} storms in {time.monotonic() - begin_s:.0f} s, {failed} failed"
    print(f"{told}; quiet within {slowest_ms / 1000:.1f} s of the heal")
    return 1 if failed or done < seeds else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--seeds", type=int, default=1000, help="how many storms")
    what.add_argument("--seed", type=int, help="one storm again")
    args = parser.parse_args()
    return many(args.seeds) if args.seed is None else again(args.seed)


if __name__ == "__main__":
    sys.exit(main())
