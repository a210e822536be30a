# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # First steps
#
# From a model to a run, a comparison, a sweep and better gains. The file is a script with markers of cells.
# `jupytext --to ipynb first-steps.py` makes a notebook of it, and Jupyter with jupytext opens it as one.
#
# The first line lets figures show themselves.

# %% [markdown]
# ## Load and simulate
#
# The paper's joint follows y_r = sin(t) from x1 = 1.5 rad. Its valve delivers at most ±10 V.

# %%
# %matplotlib inline
from pmjoint_codegen import ClosedLoop

loop = ClosedLoop.load("paper")
loop

# %%
run = loop.simulate()
run

# %% [markdown]
# A run is a mapping of columns, and a table of pandas.

# %%
run.to_dataframe()[["y", "y_r", "e", "v", "u"]].head()

# %% [markdown]
# ## Compare
#
# While the valve saturates, the paper's compensator moves the target by r1. Without it the same law tracks
# faster here.

# %%
plain = loop.simulate(compensator=False)
{name: (one.summary["settling_s"], one.ise) for name, one in (("compensator", run), ("clipping", plain))}

# %%
from pmjoint_codegen import compare

comparison = compare(run, plain, names=["compensator", "clipping"])
comparison

# %%
comparison.plot(signals=["e", "u"])

# %% [markdown]
# Any library draws the columns. The error over time, on a logarithmic scale:

# %%
import numpy as np
from matplotlib.figure import Figure

figure = Figure(figsize=(6.3, 2.6), layout="constrained")
axes = figure.subplots()
axes.semilogy(run.t, np.abs(run["e"]), label="compensator")
axes.semilogy(plain.t, np.abs(plain["e"]), label="clipping")
axes.set(xlabel="t (s)", ylabel="|e| (rad)", ylim=(1e-6, 5))
axes.legend()
figure

# %% [markdown]
# ## Another reference
#
# A function of t, an array, or an expression.

# %%
gait = loop.simulate(reference=lambda t: 0.4 * np.sin(3.0 * t) + 0.2 * np.sin(7.0 * t), horizon=6.0)
round(gait.ise, 4)

# %% [markdown]
# ## Sweep
#
# How fast should the compensator forget? 40 values of its gain; the plant's valve gain is off by up to 20 %.

# %%
from pmjoint_codegen import sweep

data = sweep(
    loop,
    grid={"ck1": np.geomspace(0.5, 20.0, 40)},
    sample={"b0_plant": "uniform(1.6, 2.4)"},
    runs=50,
    seed=7,
)
data["ise"]

# %%
figure = Figure(figsize=(6.3, 2.6), layout="constrained")
axes = figure.subplots()
low, middle, high = data["ise"].quantile([0.05, 0.5, 0.95], dim="draw")
axes.fill_between(data["ck1"], low, high, alpha=0.3, label="nine of ten plants")
axes.loglog(data["ck1"], middle, label="median")
axes.set(xlabel="ck1 (1/s)", ylabel="integral of e² (rad² s)")
axes.legend()
figure

# %% [markdown]
# ## Tune
#
# Gains that minimise the same integral while |v| stays below 200 V.

# %%
from pmjoint_codegen import tune

better = tune(loop, gains={"c": (3, 60), "ck": None}, max_v=200, generations=8, population=4, seed=7)
better

# %%
loop.simulate(parameters=better.gains)
