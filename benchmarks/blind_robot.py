"""Hold `rigd identify` to the robots of a second author: right and wrong ones.

    chrt -i 0 nice -n 19 python benchmarks/blind_robot.py --keep robot.jsonl --right 20 --minutes 30
    python benchmarks/blind_robot.py --keep robot.jsonl --summary

The simulator (`blind/robot.c`), the worlds and the words that count as their right name
(`blind/robot_worlds.py`) are written from the paper and the docs alone. It plays as
`blind_lugre.py` does.
"""

from blind_lugre import arguments, study  # noqa: I001  # before numpy: it sets its threads
from blind.judge import ROBOT

if __name__ == "__main__":
    study(arguments(__doc__).parse_args(), ROBOT)
