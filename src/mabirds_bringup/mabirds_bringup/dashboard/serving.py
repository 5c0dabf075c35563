"""ROS in a thread, the page in the main one."""

import os

import rclpy
from nicegui import ui
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup.dashboard.board import Board
from mabirds_bringup.dashboard.page import make_page
from mabirds_bringup.priority import step_back
from mabirds_bringup.watch.spinning import NICE
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.security import enclave_arguments, start_ros


def serve(experiment: Experiment, host: str, port: int, key: str) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    experiment : Experiment
        That the network learns.
    host : str
        Address.
    port : int
        Of the host.
    key : str
        For those who may control the player.
    """
    step_back(NICE)
    os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")  # as of `mabirds inspect`
    start_ros(["--ros-args", *enclave_arguments("/dashboard")], signal_handler_options=SignalHandlerOptions.NO)
    try:
        board = Board(experiment)
        board.start()
        try:
            make_page(board, key)
            ui.run(host=host, port=port, show=False, reload=False, show_welcome_message=False)
        finally:
            board.stop()
    finally:
        rclpy.try_shutdown()
