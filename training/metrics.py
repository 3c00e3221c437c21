"""How good depths and uncertainties are. All arrays (N, 48, 80); reference 0 = unknown. Means over images of means over pixels."""

import numpy as np

LEVELS = (0.5, 0.6827, 0.9, 0.95)


def laplace_quantile(level: float) -> float:
    """|r| / b below which a Laplace variable of scale b falls with this probability."""
    return -np.log(1.0 - level)


def depth_figures(depth: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    rows, scales = [], []
    for d, r in zip(depth, reference):
        known = r > 0
        if known.sum() < 50:
            continue
        d, r = d[known].astype(np.float64), r[known].astype(np.float64)
        row = []
        scale = np.median(r / d)
        scales.append(scale)
        for p in (d, d * scale):
            ratio = np.maximum(p / r, r / p)
            row += [np.mean(abs(p - r) / r), np.sqrt(np.mean((p - r) ** 2)), np.mean(ratio < 1.25)]
        rows.append(row)
    names = ("abs_rel", "rmse_m", "delta", "abs_rel_aligned", "rmse_m_aligned", "delta_aligned")
    figures = dict(zip(names, np.mean(rows, 0).tolist()))
    # The factor that an image is off by, ln (true / predicted): what it is on the whole, and how it varies between images.
    figures["factor"] = float(np.mean(np.log(scales)))
    figures["factor_sigma"] = float(np.std(np.log(scales)))
    figures["images"] = len(rows)
    # How far another draw of images would be off.
    figures["abs_rel_error"] = float(np.std([row[0] for row in rows]) / len(rows) ** 0.5)
    # Guessing one depth for all pixels of all images, the best there is: what a network must beat.
    guess = np.median(reference[reference > 0])
    figures["abs_rel_constant"] = float(np.mean([np.mean(abs(guess - r[r > 0]) / r[r > 0]) for r in reference if (r > 0).sum() >= 50]))
    return figures


def sparsification(error: np.ndarray, u: np.ndarray) -> tuple[float, float]:
    """Areas between the curves of the mean error of what is kept, over its mean, and the oracle's: by `u`, and by chance."""
    keep = np.arange(len(error), 0, -1)
    curve = lambda order: (np.cumsum(error[order])[::-1] / keep)[: int(0.99 * len(error))] / error.mean()
    # Kept are the least uncertain ones.
    oracle = curve(np.argsort(error))
    return float(np.mean(curve(np.argsort(u, kind="stable")) - oracle)), float(np.mean(1.0 - oracle))


def uncertainty_figures(depth, u, reference, sigma_per_u: float) -> dict[str, float]:
    """AUSE of the relative error by image, the same of a random ranking, their ratio (also over the pixels of all images
    together), and the share of log-depth errors within what `sigma_per_u * u` promises."""
    ranked, random, all_errors, all_u = [], [], [], []
    covered = {level: [] for level in LEVELS}
    for d, s, r in zip(depth, u, reference):
        known = r > 0
        if known.sum() < 50:
            continue
        d, s, r = d[known].astype(np.float64), s[known].astype(np.float64), r[known].astype(np.float64)
        error = abs(d - r) / r
        for area, areas in zip(sparsification(error, s), (ranked, random)):
            areas.append(area)
        all_errors.append(error)
        all_u.append(s)
        log_error = abs(np.log(d / r))
        for level in LEVELS:
            reach = sigma_per_u * s * laplace_quantile(level) / laplace_quantile(0.6827)
            covered[level].append(np.mean(log_error <= reach))
    pooled = sparsification(np.concatenate(all_errors), np.concatenate(all_u))
    figures = {"ause": float(np.mean(ranked)), "ause_random": float(np.mean(random))}
    figures["ause_ratio"] = figures["ause"] / figures["ause_random"]
    figures["ause_ratio_pooled"] = pooled[0] / pooled[1]
    for level in LEVELS:
        figures[f"coverage_{round(100 * level)}"] = float(np.mean(covered[level]))
    return figures


def fitted_sigma_per_u(depth, u, reference) -> float:
    """The factor for which 68 % of the log-depth errors lie within `sigma_per_u * u`; all images count the same."""
    ratios, weights = [], []
    for d, s, r in zip(depth, u, reference):
        known = r > 0
        if known.sum() >= 50:
            ratios.append(abs(np.log(d[known] / r[known])) / s[known])
            weights.append(np.full(known.sum(), 1.0 / known.sum()))
    ratios, weights = np.concatenate(ratios), np.concatenate(weights)
    order = np.argsort(ratios)
    total = np.cumsum(weights[order])
    return float(ratios[order][np.searchsorted(total, 0.6827 * total[-1])])
