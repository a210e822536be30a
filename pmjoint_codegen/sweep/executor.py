"""Compute the missing chunks, over threads here or over the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from typing import Any, Final

from pmjoint_codegen.errors import MissingToolError, PmjointError, SimulationError, UsageError, installing
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.sweep.build_inputs import BuildInputs, library_of
from pmjoint_codegen.sweep.chunks import Result, simulate_chunk
from pmjoint_codegen.sweep.plan import Plan
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.store import Store

NEEDED: Final = "pmjoint-codegen[sweep]"
AHEAD: Final = 3  # chunks queued for each worker: memory does not grow with the sweep
PATIENCE_S: Final = 30  # for a scheduler that does not answer

Tell = Callable[[int], None]


def execute(
    store: Store,
    inputs: BuildInputs,
    *,
    threads: int,
    scheduler: str | None,
    tell: Tell,
    starts: Sequence[int] | None = None,
) -> None:
    """Compute and store every missing chunk, or those that are named.

    Args:
        store: of the sweep, open.
        inputs: the model.
        threads: to compute with here; not used with a scheduler.
        scheduler: address of a Dask scheduler, or None.
        tell: called periodically with the number of runs completed.
        starts: first runs of the chunks to compute; None: of all that are missing or damaged.

    Raises:
        MissingToolError: no compiler, or Dask is not installed.
        BuildError: the compiler failed.
        SimulationError: the connection to the scheduler was lost; what is done is kept.
        UsageError: the scheduler does not answer, or the folder cannot be written.
    """
    missing = store.missing() if starts is None else list(starts)
    store.renew(missing)
    done = store.request.plan.runs - sum(store.length(start) for start in missing)
    tell(done)
    made = (
        _on_cluster(store, inputs, missing, scheduler)
        if scheduler is not None
        else _on_threads(store, inputs, missing, threads)
    )
    for start, result in made:
        store.keep(start, result)
        done += store.length(start)
        tell(done)


def _on_threads(
    store: Store, inputs: BuildInputs, missing: list[int], threads: int
) -> Iterator[tuple[int, Result]]:
    if not missing:
        return
    library = library_of(inputs, os.environ)
    waiting: dict[Future[Result], int] = {}
    queue = iter(missing)
    with ThreadPoolExecutor(threads) as pool:
        try:
            while True:
                for start in _take(queue, threads * (1 + AHEAD) - len(waiting)):
                    columns = store.request.plan.columns(start, start + store.length(start))
                    waiting[pool.submit(simulate_chunk, library, store.request, columns)] = start
                if not waiting:
                    return
                ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in ready:
                    yield waiting.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _take(queue: Iterator[int], count: int) -> Iterator[int]:
    """Up to `count` items."""
    for _ in range(count):
        item = next(queue, None)
        if item is None:
            return
        yield item


def _on_cluster(
    store: Store, inputs: BuildInputs, missing: list[int], address: str
) -> Iterator[tuple[int, Result]]:
    distributed = _distributed()  # its interface is untyped
    _check_address(distributed, address)
    with _quiet():
        yield from _with_client(distributed, store, inputs, missing, address)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from logging the tracebacks of lost connections: the essential comes as an error."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def _with_client(
    distributed: Any, store: Store, inputs: BuildInputs, missing: list[int], address: str
) -> Iterator[tuple[int, Result]]:
    try:
        client = distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            f"does not answer ({error})",
            where=f"--scheduler {address}",
            remedy="start one: dask scheduler, and workers: dask worker ADDRESS",
        ) from None
    with client:
        try:
            yield from farm_out(distributed, client, store, inputs, missing)
        except (CancelledError, distributed.comm.CommClosedError) as error:
            raise _lost(f"--scheduler {address}") from error


def _check_address(distributed: Any, address: str) -> None:
    """Refuse an invalid address at once: a client would take a minute to give up."""
    try:
        distributed.comm.get_address_host_port(address)
    except ValueError as error:
        raise UsageError(
            f"is not an address ({error})",
            where=f"--scheduler {address}",
            remedy="allowed: the address that the scheduler prints, such as tcp://10.0.0.1:8786",
        ) from None


def farm_out(
    distributed: Any, client: Any, store: Store, inputs: BuildInputs, missing: list[int]
) -> Iterator[tuple[int, Result]]:
    """Submit chunks, a few ahead of every worker; Dask repeats those that are lost with a worker.

    Args:
        distributed: the library.
        client: connected to a scheduler.
        store: of the sweep.
        inputs: the model.
        missing: first runs of the chunks to compute.

    Yields:
        First run and result of each, as they are done.

    Raises:
        UsageError: the scheduler has no workers.
        SimulationError: the connection to the scheduler was lost.
        PmjointError: a worker cannot compute.
    """
    plan, queue = store.request.plan, iter(missing)
    model = _on_all_workers(client, inputs)
    light = replace(store.request, plan=Plan(()))  # the columns replace the plan: a task stays small
    name, starts = f"pmjoint-{store.request.hash[:16]}", dict[Any, int]()
    running = distributed.as_completed(loop=client.loop)

    def hand_out() -> None:
        threads = max(
            1, sum(client.nthreads().values())
        )  # re-evaluated: workers may join or leave a running sweep
        for start in _take(queue, threads * (1 + AHEAD) - len(starts)):
            columns = plan.columns(start, start + store.length(start))
            key = f"{name}-{start}"
            starts[key] = start
            running.add(client.submit(simulate_on_worker, model, light, columns, key=key))

    hand_out()
    for future in running:
        yield starts.pop(future.key), _result(future)
        hand_out()


def _result(future: Any) -> Result:
    """A worker's result, or its error with the place "on a worker"."""
    try:
        result: Result = future.result()
    except CancelledError as error:  # this program never cancels
        raise _lost("--scheduler") from error
    except PmjointError as error:
        error.where = error.where or "on a worker"
        raise
    except Exception as error:
        raise MissingToolError(
            f"a worker failed ({type(error).__name__}: {error})",
            where="--scheduler",
            remedy="workers need pmjoint-codegen[sweep] of this version and a C compiler",
        ) from error
    return result


def _lost(where: str) -> SimulationError:
    return SimulationError(
        "the connection was lost",
        where=where,
        remedy="finished runs are kept: restart it, and the same command resumes there",
    )


def _on_all_workers(client: Any, inputs: BuildInputs) -> Any:
    try:
        return client.scatter(inputs, broadcast=True)
    except TimeoutError:
        raise UsageError(
            "has no workers", where="--scheduler", remedy="start some: dask worker ADDRESS"
        ) from None


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ModuleNotFoundError as error:
        raise MissingToolError(
            f"{error.name} is needed for --scheduler", remedy=f"install it: {installing(NEEDED)}"
        ) from None


def simulate_on_worker(inputs: BuildInputs, request: Request, columns: Mapping[str, Array]) -> Result:
    """A task of the cluster: `simulate_chunk` with a library that the worker keeps."""
    kept: dict[BuildInputs, BatchLibrary] = vars(_distributed().get_worker()).setdefault(
        "pmjoint_libraries", {}
    )
    if inputs not in kept:
        kept[inputs] = library_of(inputs, os.environ)
    return simulate_chunk(kept[inputs], request, columns)
