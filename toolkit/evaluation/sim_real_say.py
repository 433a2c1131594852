"""What the rig's forecast was worth, in words."""

from collections.abc import Sequence

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.agreement import RankCorrelation
from toolkit.evaluation.couples import Couple
from toolkit.evaluation.order import OWNERS, name_booster
from toolkit.evaluation.say import SIGNIFICANT, Headline, say_count, say_test
from toolkit.evaluation.sim_real import FlipForecast, SimReal, SimRealRow


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
