"""The command line: each command a few lines over the library.

Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 something is missing on the machine, 70 a bug in Executive,
130 interrupted, 143 asked to end (SIGTERM). Whatever goes wrong is one line on stderr; `executive --debug ...` shows
the traceback instead.

Everything heavy is imported inside the command that needs it, so that `executive --help` answers at once.
"""

from executive.cli.app import (
    BAD_INPUT,
    BUG,
    INTERRUPTED,
    NOT_REACHED,
    REACHED,
    TERMINATED,
    Settings,
    app,
    exit_code,
    main,
)
from executive.cli.campaign_commands import bench
from executive.cli.check_command import check
from executive.cli.export_commands import export
from executive.cli.film_command import film
from executive.cli.planning_commands import plan
from executive.cli.problem_commands import problems
from executive.cli.replay_commands import replay
from executive.cli.run_commands import explain, inspect, resume, run
from executive.cli.setup_commands import doctor, domains, faults, new
from executive.cli.vision_commands import calibrate, collect, estimate, evaluate, train

__all__ = [
    "BAD_INPUT",
    "BUG",
    "INTERRUPTED",
    "NOT_REACHED",
    "REACHED",
    "TERMINATED",
    "Settings",
    "app",
    "exit_code",
    "main",
]

# In the order in which the help lists them.
app.command()(run)
app.command()(resume)
app.command()(estimate)
app.command()(film)
app.command()(collect)
app.command("eval")(evaluate)
app.command()(calibrate)
app.command()(train)
app.command()(bench)
app.command()(plan)
app.command()(problems)
app.command()(explain)
app.command()(replay)
app.command()(inspect)
app.add_typer(export, name="export")
app.command()(check)
app.command()(domains)
app.command()(faults)
app.command()(new)
app.command()(doctor)
