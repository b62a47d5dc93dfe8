"""A sweep on jobs of Slurm (`pip install dask-jobqueue`): python on_slurm.py SWEEP.toml OUT

A job that is preempted or dies is replaced, and its runs are computed again. Called again, it goes on.
"""

import pathlib
import sys

from armplane import experiments
from armplane.experiments.__main__ import read_file
from dask_jobqueue import SLURMCluster
from distributed import Client

with SLURMCluster(cores=4, processes=4, memory="4GB") as cluster, Client(cluster) as client:
    cluster.adapt(maximum_jobs=16)
    _, arguments = read_file(pathlib.Path(sys.argv[1]).resolve())
    table = experiments.sweep(**arguments, out=sys.argv[2], client=client)
print(table["outcome"].value_counts())
