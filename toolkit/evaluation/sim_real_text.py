"""The rig against photographs, in words and as a table on the console."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.metrics import OWNERS, name_booster
from toolkit.evaluation.sim_real import Couple, FlipForecast, RankCorrelation, SimReal, SimRealRow
from toolkit.evaluation.verdict import SIGNIFICANT, Headline, say_count, say_test


def write_sim_real(arch: str, comparisons: Sequence[SimReal]) -> list[Headline]:
    """A headline for each rendered source against photographs: of its first booster, or of the bare objects."""
    return [_head(arch, one, _pick_row(one)) for one in comparisons]


def say_points(share: float) -> str:
    """`-6`, `0`, `+11`: a difference of shares in percentage points."""
    points = round(100 * share)
    return "0" if points == 0 else f"{points:+d}".replace("-", "−")


def say_interval(interval: tuple[float, float]) -> str:
    """`-21 to +9`, in percentage points."""
    return f"{say_points(interval[0])} to {say_points(interval[1])}"


def say_rank(rank: RankCorrelation) -> str:
    """`0.81 (0.55 to 0.93)`, `0.81` or why there is none."""
    if rank.rho is None:
        return rank.why
    return _minus(f"{rank.rho:.2f}" + (f" ({rank.ci95[0]:.2f} to {rank.ci95[1]:.2f})" if rank.ci95 else ""))


def say_kappa(forecast: FlipForecast) -> str:
    """`0.45`, or `all equal` where nothing can be told apart."""
    return "all equal" if forecast.kappa is None else _minus(f"{forecast.kappa:.2f}")


def list_wrong(couples: Sequence[Couple]) -> list[tuple[str, str, list[str]]]:
    """(object, variant, poses): the pose ids that were predicted wrongly, marked + where the photograph did better."""
    found: dict[tuple[str, str], list[str]] = {}
    for couple in couples:
        name, variant, pose_id = couple.place
        mark = "+" if couple.real.correct_top1 else "−"
        found.setdefault((name, variant), []).append(f"{pose_id}{mark}")
    return [(*key, poses) for key, poses in found.items()]


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _pick_row(one: SimReal) -> SimRealRow:
    rows = {row.variant: row for row in one.rows if row.object == POOLED}
    boosters = [name for name in rows if name != UNPATCHED and name not in OWNERS]
    return rows[(boosters or list(rows))[0]]


def _head(arch: str, one: SimReal, row: SimRealRow) -> Headline:
    low_rank = row.rank.ci95[0] if row.rank.ci95 else 0.0
    if row.mcnemar_p < SIGNIFICANT:
        tone, verdict = "bad", "The rig promises too " + ("much" if row.gap < 0 else "little")
    elif low_rank > 0:
        tone, verdict = "good", "The rig ranks the poses as the photographs do, and no gap is shown"
    else:
        tone, verdict = "open", "No gap is shown, nor that the rig knows which poses are hard"
    if row.mcnemar_p < SIGNIFICANT and low_rank > 0:
        tone, verdict = "open", f"{verdict}, but ranks the poses as the photographs do"
    what = "without a booster" if row.variant == UNPATCHED else f"with {name_booster(row.variant)}"
    sentence = (
        f"On {row.n} poses {what} {arch} is right on {say_count(row.n_sim, row.n)} in {one.sim} and on "
        f"{say_count(row.n_real, row.n)} in {one.real}: a gap of {say_points(row.gap)} points (95 % interval "
        f"{say_interval(row.gap_ci95)}, {say_test(row.mcnemar_p)}). Predicted wrongly: "
        f"{row.sim_only + row.real_only} of {row.n}. Rank correlation over poses of the true class's probability: "
        f"{say_rank(row.rank)}."
    )
    forecast = next((own for own in one.forecasts if (own.object, own.variant) == (POOLED, row.variant)), None)
    if forecast is not None:
        sentence += f" {_say_forecast(forecast)}"
    return Headline(f"{one.sim} and {one.real}", row.variant, tone, verdict, sentence)


def _say_forecast(forecast: FlipForecast) -> str:
    gained = forecast.both + forecast.real_only
    kappa = "" if forecast.kappa is None else f" (Cohen's kappa {say_kappa(forecast)})"
    return (
        f"{name_booster(forecast.variant).capitalize()} adds {say_points(forecast.sim_gain)} points in the rig and "
        f"{say_points(forecast.real_gain)} in photographs; of {gained} gained in photographs the rig foresaw "
        f"{forecast.both}, and it foresaw {forecast.sim_only} that were not{kappa}."
    )


MAX_ROWS, MAX_WRONG = 60, 12


def print_sim_real(console: Console, comparisons: Sequence[SimReal]) -> None:
    """Print, for each pair of sources, the gap, the ranks, the gains, and the poses that were predicted wrongly."""
    for one in comparisons:
        console.print(_gaps(one))
        forecasts = pick_own(one.forecasts)
        if forecasts:
            console.print(_gains(forecasts))
        for line in _say_rest(one):
            console.print(line, markup=False, soft_wrap=True)
        console.print()


def pick_own(rows: Sequence, max_rows: int = MAX_ROWS) -> list:
    """The rows worth showing: the pooled alone when they are too many, none pooled for one object."""
    single = [row for row in rows if row.object != POOLED]
    if len({row.object for row in single}) == 1:
        return single
    return list(rows) if len(single) <= max_rows else [row for row in rows if row.object == POOLED]


def _gaps(one: SimReal) -> Table:
    table = _start(f"{one.sim} and {one.real}: {len(one.couples)} pairs of images of the same pose")
    for name in ("n", "sim %", "real %", "gap (95 %)", "p", "rank correlation"):
        table.add_column(name, justify="right", no_wrap=True)
    last = ""
    for row in pick_own(one.rows):
        table.add_row(*_sim_real_table_head(row, last), *_numbers(row), style=_style(row))
        last = row.object
    return table


def _numbers(row: SimRealRow) -> list[str]:
    p = "<0.0001" if row.mcnemar_p < 1e-4 else f"{row.mcnemar_p:.2g}"
    gap = f"{say_points(row.gap)} ({say_interval(row.gap_ci95)})"
    shares = [f"{100 * count / row.n:.0f}" for count in (row.n_sim, row.n_real)]
    return [str(row.n), *shares, gap, p, say_rank(row.rank)]


def _gains(forecasts: Sequence[FlipForecast]) -> Table:
    table = _start("poses gained over unpatched, foreseen by the rig or not")
    for name in ("n", "both", "sim only", "real only", "neither", "kappa", "adds sim", "adds real"):
        table.add_column(name, justify="right", no_wrap=True)
    last = ""
    for row in forecasts:
        counts = [str(count) for count in (row.n, row.both, row.sim_only, row.real_only, row.neither)]
        adds = [say_points(row.sim_gain), say_points(row.real_gain)]
        table.add_row(*_sim_real_table_head(row, last), *counts, say_kappa(row), *adds, style=_style(row))
        last = row.object
    return table


def _start(title: str) -> Table:
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("object", overflow="fold", min_width=6)
    table.add_column("variant", overflow="fold", min_width=9)
    return table


def _sim_real_table_head(row: SimRealRow | FlipForecast, last: str) -> tuple[Text, Text]:
    return Text("" if row.object == last else row.object), Text(row.variant)


def _style(row: SimRealRow | FlipForecast) -> str:
    return "bold" if row.object == POOLED else ""


def _say_rest(one: SimReal) -> list[str]:
    lines = []
    if one.wrong:
        marks = "− the photograph does worse, + better"
        lines.append(f"predicted wrongly, {len(one.wrong)} of {len(one.couples)} ({marks}):")
        found = list_wrong(one.wrong)
        lines += [f"  {name} {variant}: pose {', '.join(poses)}" for name, variant, poses in found[:MAX_WRONG]]
        if len(found) > MAX_WRONG:
            lines.append(f"  and {len(found) - MAX_WRONG} more lines, all in summary.json")
    for name, left in ((one.real, one.unmatched_real), (one.sim, one.unmatched_sim)):
        if left:
            images = "image" if len(left) == 1 else "images, the first"
            lines.append(f"not compared, {name}: {len(left)} {images} {left[0][0]}: {left[0][1]}")
    return lines
