"""What ``mabirds-expert-player --help`` prints."""

HELP = """Stream recorded demonstrations, each learner's to that learner alone.

usage: mabirds-expert-player --ros-args -p experiment:=FILE [-p PARAMETER:=VALUE ...]

example: mabirds-expert-player --ros-args -p experiment:=ros_ws/config/patrol.yaml -p rate:=10

parameters:
  experiment          path of the experiment file (YAML)
  run                 name of this run; learners of other runs get nothing ("")
  baseline            a central method that learns in the learners' place, such as bics ("")
  bag                 bag to play; empty: the experiment's
  bag_digest          digest of the demonstrations that it must hold, such as a manifest names; empty: any ("")
  bags                several bags to play as one, in the place of bag
  include, exclude    learners to play to or not to, by name or regular expression
  listeners           play to topics that nobody learns from, too (false)
  rate                speed, as a multiple of the recorded timing (1.0); may change while it runs
  hz                  demonstrations per second; 0: the recorded timing times rate (0.0); may change while it runs
  max_in_flight       demonstrations ahead of what a learner has learned (16)
  max_gap             recorded seconds to which longer pauses are shortened; 0: none is (0.0)
  delay               seconds to wait before the first demonstration (0.0)
  start_paused        begin paused (false)
  start_offset        recorded seconds to leave out at the beginning (0.0)
  start_iteration     the first demonstration to play (1)
  playback_duration   recorded seconds to play; 0: all (0.0)
  playback_until      recorded seconds after the beginning at which to end; 0: all (0.0)
  loop                how often to play to topics that nobody learns from; 0: without end (1)
  clock               how often a second the recorded time goes to /clock; 0: never (0.0)
  wait_for_all_acked  at the end, seconds to wait until all who hear have all; -1: none (-1.0)
  read_ahead          demonstrations of each learner that are read before they are due (100)
  stay                stay after the end, for the services play and seek (false)

services, as rosbag2's: ~/pause, ~/resume, ~/toggle_paused, ~/is_paused, ~/get_rate, ~/set_rate, ~/play, ~/play_next,
  ~/burst, ~/seek, ~/stop; and ~/resend. Reasons are in the log and in ~/player_status.

It ends when everything is learned or played, or on SIGINT or SIGTERM.
Exit codes: 0 finished or ended as asked, 2 wrong experiment, bag or parameter."""
