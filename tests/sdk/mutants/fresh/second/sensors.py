"""Mistakes in an encoder with a load cell on UDP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the resolution of the rig file is not used",
        "with a scale of 5 um per count all positions are a fifth of the truth",
        (("position=counts * self.config.resolution,", "position=counts * 1e-6,"),),
    ),
    Fresh(
        "the two status bits are exchanged",
        "an interlock on the end of the force range acts whenever the encoder is referenced",
        (
            (
                'status_bits={"force_at_rail": 1, "referenced": 2}',
                'status_bits={"referenced": 1, "force_at_rail": 2}',
            ),
        ),
    ),
    Fresh(
        "a damaged frame ends read before the next question",
        "each damaged frame costs two rows instead of one, and a good one behind it waits a cycle",
        (
            (
                "            if reply is not None and reply[0] != self._answered:\n",
                "            if reply is None:\n"
                "                return None\n"
                "            if reply[0] != self._answered:\n",
            ),
        ),
    ),
    Fresh(
        "answers with the values of the last one are left out",
        "while the slider rests there are no rows: the sensor counts as failed",
        (
            (
                "            if reply is not None and reply[0] != self._answered:\n"
                "                newest = reply\n"
                "                self._answered = reply[0]\n",
                "            if reply is not None and reply[1:] != self._answered:\n"
                "                newest = reply\n"
                "                self._answered = reply[1:]\n",
            ),
        ),
    ),
    Fresh(
        "positions are rounded to 0.1 mm",
        "an encoder of 1 um shows steps of 100 um: no slip below that is seen",
        (
            (
                "position=counts * self.config.resolution,",
                "position=round(counts * self.config.resolution, 4),",
            ),
        ),
    ),
    Fresh(
        "read receives until nothing is left",
        "a flood of frames from a broken device holds the cycle, and with it every other device",
        (("        for _ in range(MOST_FRAMES):\n", "        while True:\n"),),
    ),
    Fresh(
        "a sensor that does not answer leaves its socket open",
        "the supply is switched on a minute late: each new try says that it is open already",
        (
            (
                "        except (OSError, LinkError) as error:\n",
                "        except OSError as error:\n",
            ),
        ),
    ),
    Fresh(
        "number 0 counts as no answer",
        "of 256 rows one is missing, in every recording",
        (
            (
                "if reply is not None and reply[0] != self._answered:",
                "if reply and reply[0] and reply[0] != self._answered:",
            ),
        ),
    ),
)
