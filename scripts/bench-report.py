# Prints what scripts/bench-compare has measured, against its bars; exit status 1 when one is missed.
#
# usage: bench-report.py FOLDER table|json|markdown
import json
import pathlib
import sys

folder, form = pathlib.Path(sys.argv[1]), sys.argv[2]


def read(name):
    return json.loads((folder / name).read_text())


rows = []


def row(what, value, bar, detail, above=False):
    """A measured value that has to stay at or under its bar (or, `above`, reach it)."""
    ok = value >= bar if above else value <= bar
    rows.append({"what": what, "value": round(value, 3), "bar": bar, "met": ok, "detail": detail})


def times(bench):
    return f'{bench["median_ms"]:.0f} ms (fastest {bench["min_ms"]:.0f})'


def vtk_times(vtk):
    return f'{vtk["median_s"] * 1e3:.0f} ms (fastest {vtk["min_s"] * 1e3:.0f})'


scenes = sorted(f.name.removesuffix(".bench.json") for f in folder.glob("*.bench.json"))
if not scenes:
    sys.exit("no scene was measured")
for scene in scenes:
    bench, processor, cpu, gpu = (read(f"{scene}.{part}.json") for part in ("bench", "processor", "vtk-cpu", "vtk-gpu"))
    equal, error = read(f"{scene}.equal.json"), read(f"{scene}.equal-error.json")
    for who, own, bars in (("driver", bench, (0.30, 0.03)), ("processor", processor, (0.12, 0.02))):
        for name, vtk, bar in zip(("CPU", "GPU"), (cpu, gpu), bars):
            row(f"{scene}, {who}: time over VTK's {name} mapper", own["median_ms"] / (vtk["median_s"] * 1e3), bar,
                f"{times(own)} to {vtk_times(vtk)}")
    one, two = (min((json.loads(turn.read_text()) for turn in folder.glob(f"{scene}.{threads}.*.json")), key=lambda bench: bench["min_ms"])
                for threads in ("one-thread", "two-threads"))
    row(f"{scene}, processor: speed of two threads over one", one["min_ms"] / two["min_ms"], 1.9,
        f"{times(one)} to {times(two)}", above=True)
    reached = error["error"] <= error["vtk_error"]
    for who, own, bar in (("driver", equal, 0.20), ("processor", read(f"{scene}.equal-processor.json"), 0.10)):
        row(f"{scene}, {who}: over VTK's CPU mapper at equal error", own["median_ms"] / (cpu["median_s"] * 1e3) if reached else 99.0, bar,
            f'{times(own)} at {error["sample_distance_mm"]} mm, {error["error"]:.2f}/255 to {error["vtk_error"]:.2f}/255')
    row(f"{scene}: ms for another transfer function", bench["transfer_change_ms"], 50.0, "before the frame")
    row(f"{scene}: ms for another clip plane", bench["clip_change_ms"], 0.5, "before the frame")
dense = read("dense.json")
row("share of the driver's rate, dense and unskipped", dense["share"], 0.5,
    f'{dense["samples_per_s"] / 1e6:.0f} of {dense["driver_samples_per_s"] / 1e6:.0f} million/s', above=True)
sizes = sorted((int(f.stem.removeprefix("size-")), json.loads(f.read_text())) for f in folder.glob("size-*.json"))
for (small, before), (large, after) in zip(sizes, sizes[1:]):
    row(f"growth of time over growth of voxels, {small}³ to {large}³",
        (after["median_ms"] / before["median_ms"]) / (large / small) ** 3, 1.0, f"{times(before)} to {times(after)}")
soak = read("soak.json")
row(f'MiB grown over {soak["frames"]} frames', soak["rss_growth_mib"], 8.0, f'peak {soak["peak_rss_mib"]:.0f} MiB')



def markdown():
    """The table of docs/SPEED.md: times of a frame, and their ratios to VTK's CPU mapper."""
    print("| scene | VTK, CPU mapper | VTK, GPU mapper | Relief, software driver | Relief, processor | driver, processor over VTK's CPU mapper |")
    print("|---|---|---|---|---|---|")
    for scene in scenes:
        cpu, gpu = (read(f"{scene}.vtk-{mapper}.json")["median_s"] * 1e3 for mapper in ("cpu", "gpu"))
        driver, processor = (read(f"{scene}.{part}.json")["median_ms"] for part in ("bench", "processor"))
        print(f"| {scene} | {cpu:.0f} ms | {gpu:.0f} ms | {driver:.0f} ms | {processor:.0f} ms | {driver / cpu:.2f}, {processor / cpu:.3f} |")
    print("\n| measured | value | bar | |\n|---|---|---|---|")
    for r in rows:
        print(f'| {r["what"]} | {r["value"]:.3g} | {r["bar"]:g} | {"" if r["met"] else "missed: "}{r["detail"]} |')


if form == "json":
    print(json.dumps({"adapter": dense["adapter"], "driver": dense["driver"], "rows": rows}, indent=2, ensure_ascii=False))
elif form == "markdown":
    markdown()
else:
    print(f'{dense["adapter"]} ({dense["driver"]})')
    for r in rows:
        print(f'{"ok" if r["met"] else "MISSED":<7} {r["what"]:<60} {r["value"]:>9.3f}  bar {r["bar"]:<5}  {r["detail"]}')
sys.exit(0 if all(r["met"] for r in rows) else 1)
