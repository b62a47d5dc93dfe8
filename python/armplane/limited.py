"""Calls a function in a process of its own, with limits of time and memory: files of others can make libraries of others hang or crash."""

import faulthandler
import multiprocessing
import os
import resource

# Share of the machine's memory that such a process may take.
MEMORY = 0.75


class Ended(Exception):
    """A limit has ended the function, a crash, or an error of its own; the words say which."""


def limited(seconds, function, *arguments):
    """The result of a function. Raises `Ended`, or the ValueError, OSError or ImportError of the function with its words."""
    context = multiprocessing.get_context("fork")
    receive, send = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(send, function, arguments))
    child.start()
    send.close()
    try:
        if not receive.poll(seconds):
            raise Ended(f"takes more than {seconds:g} s")
        kind, answer = receive.recv()
    except EOFError:
        child.join()
        raise Ended(f"makes its reader crash (exit code {child.exitcode})") from None
    finally:
        child.kill()
        child.join()
    if kind is None:
        return answer
    raise kind(answer)


def _answer(send, function, arguments):
    memory = int(MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Nothing that a library prints, or a handler of crashes, may come between the answers.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    faulthandler.disable()
    try:
        send.send((None, function(*arguments)))
    except MemoryError:
        send.send((Ended, "needs more memory than there is"))
    except (ValueError, OSError, ImportError) as error:
        send.send((next(kind for kind in (ValueError, OSError, ImportError) if isinstance(error, kind)), str(error)))
    except Exception as error:
        send.send((Ended, f"makes its reader fail ({type(error).__name__}: {' '.join(str(error).split())[:120]})"))
