"""``mabirds bench``: experiments over many seeds, with tables and pictures."""

import typer

from mabirds_bringup.commands.bench_behaviour import behaviour
from mabirds_bringup.commands.bench_continuous import continuous
from mabirds_bringup.commands.bench_discrete import discrete

bench_app = typer.Typer(help="Experiments over many seeds, with tables and pictures.")
bench_app.command()(discrete)
bench_app.command()(continuous)
bench_app.command()(behaviour)
