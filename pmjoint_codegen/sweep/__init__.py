"""Many runs of one model: over grids and samples of initial states, parameters and gains.

plan      grids and samples -> the values of every run, the same for the same seed
request   everything that the result depends on, and its hash
inputs       data that a process needs to compute: manifest and C sources, small enough to send
chunks    values -> metrics, by the batch library; threads, chunks and machines change no bit
executor  chunks over threads, or over a Dask cluster
store     finished chunks, on disk, so that an interrupted sweep can resume; then one labelled dataset
maps      the dataset as figures
"""

from pmjoint_codegen.called import make_callable

make_callable(__name__)  # `pmjoint_codegen.sweep(...)`: see `studies.sweep`
