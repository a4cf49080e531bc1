# A report of `relief annotate compare` computed again from its landmarks.csv and measures.csv.
#
# usage: readers.py DIR
#
# Correlations by the analysis of variance in numpy, and by pingouin where it is installed, which has the confidence intervals
# as well; limits of agreement and errors in numpy. Prints one JSON object: how many figures were compared, and the largest
# differences. Exit status 3 without numpy.
import csv
import json
import pathlib
import sys

try:
    import numpy as np
except ImportError:
    sys.exit(print("that Python has no numpy", file=sys.stderr) or 3)
try:
    import pandas
    import pingouin
except ImportError:
    pingouin = None

folder = pathlib.Path(sys.argv[1])


def rows(name):
    with open(folder / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def values():
    """quantity -> set -> target -> value, with the truth's or the mean's under the set "reference"."""
    found = {}
    for row in rows("landmarks.csv"):
        target = (row["case"], row["list"], row["landmark"])
        for axis in "lps":
            of = found.setdefault(axis.upper(), {})
            of.setdefault(row["set"], {})[target] = float(row[f"{axis}_mm"])
            if row[f"reference_{axis}_mm"]:
                of.setdefault("reference", {})[target] = float(row[f"reference_{axis}_mm"])
    for row in rows("measures.csv"):
        target = (row["case"], row["list"], row["item"])
        of = found.setdefault(row["measure"], {})
        if row["value"]:
            of.setdefault(row["set"], {})[target] = float(row["value"])
        if row["reference"]:
            of.setdefault("reference", {})[target] = float(row["reference"])
    return found


def icc_2_1(table):
    """Shrout and Fleiss's ICC(2,1) by a two-way analysis of variance."""
    n, k = table.shape
    grand = table.mean()
    rows_ss = k * ((table.mean(axis=1) - grand) ** 2).sum()
    columns_ss = n * ((table.mean(axis=0) - grand) ** 2).sum()
    msr = rows_ss / (n - 1)
    msc = columns_ss / (k - 1)
    mse = (((table - grand) ** 2).sum() - rows_ss - columns_ss) / ((n - 1) * (k - 1))
    return (msr - mse) / (msr + (k - 1) * mse + k * (msc - mse) / n)


def of_pingouin(table):
    n, k = table.shape
    long = pandas.DataFrame(
        {"t": np.repeat(np.arange(n), k), "r": np.tile(np.arange(k), n), "v": table.ravel()}
    )
    found = pingouin.intraclass_corr(long, targets="t", raters="r", ratings="v")
    row = found[found["Type"].isin(["ICC2", "ICC(A,1)"])].iloc[0]
    interval = next(row[name] for name in ("CI95", "CI95%") if name in row.index)
    return float(row["ICC"]), [float(bound) for bound in interval]


def main():
    found = values()
    report = {"icc": 0, "limits": 0, "icc_difference": 0.0, "limits_difference": 0.0, "error_difference": 0.0}
    intervals = []
    for row in rows("icc.csv"):
        report["icc"] += 1
        of = found[row["quantity"]]
        sets = row["sets"].split(" ")
        common = [target for target in of[sets[0]] if all(target in of[name] for name in sets)]
        table = np.array([[of[name][target] for name in sets] for target in common])
        if row["undefined"]:
            assert len(common) < 2 or not np.ptp(table, axis=0).any(), row
            continue
        ours = float(row["icc_2_1"])
        theirs = [icc_2_1(table)]
        if pingouin is not None and ours < 1.0:
            icc, interval = of_pingouin(table)
            theirs.append(icc)
            intervals += [abs(a - float(row[b])) for a, b in zip(interval, ("low_95", "high_95"))]
        report["icc_difference"] = max(report["icc_difference"], *(abs(ours - value) for value in theirs))
    for row in rows("bland-altman.csv"):
        report["limits"] += 1
        of = found[row["quantity"]]
        second = of.get("reference" if row["relation"] == "truth" else row["second"], {})
        first = of[row["first"]]
        differences = np.array([first[target] - second[target] for target in first if target in second])
        if row["undefined"]:
            assert len(differences) < 2, row
            continue
        bias, deviation = differences.mean(), differences.std(ddof=1)
        theirs = [bias, deviation, bias - 1.96 * deviation, bias + 1.96 * deviation]
        ours = [float(row[name]) for name in ("bias", "deviation", "lower_limit", "upper_limit")]
        report["limits_difference"] = max(report["limits_difference"], np.abs(np.subtract(ours, theirs)).max())
    landmarks = rows("landmarks.csv")
    for row in rows("errors.csv"):
        if row["of"] != "set":
            continue
        errors = np.array(
            [
                [float(of[f"error_{axis}_mm"]) for axis in "lps"]
                for of in landmarks
                if of["set"] == row["set"] and of["distance_mm"]
            ]
        )
        lengths = np.linalg.norm(errors, axis=1)
        theirs = [*errors.mean(axis=0), lengths.mean(), np.median(lengths), np.percentile(lengths, 95)]
        names = ("bias_l_mm", "bias_p_mm", "bias_s_mm", "mean_mm", "median_mm", "p95_mm")
        ours = [float(row[name]) for name in names]
        report["error_difference"] = max(report["error_difference"], np.abs(np.subtract(ours, theirs)).max())
    report["interval_difference"] = max(intervals) if intervals else None
    print(json.dumps(report, default=float))


main()
