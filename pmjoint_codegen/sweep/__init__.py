"""Many runs of one model: over grids and samples of initial states, parameters and gains.

plan      grids and samples -> the values of every run, the same for the same seed
request   everything that the result depends on, and its hash
inputs       what a process needs to compute: manifest and C sources, small enough to send
chunks    values -> metrics, by the batch library; neither threads nor chunks nor machines change a bit
drive     chunks over threads, or over a Dask cluster
store     what is done, on disk, so that an interrupted sweep goes on; then one labelled dataset
maps      the dataset as figures
"""
