"""Which files can be written of which data."""

from __future__ import annotations

from mssegment.cli.common import flag_of
from mssegment.configuration import Configuration
from mssegment.errors import UsageError
from mssegment.registry import EXPORTS

ONLY_OF_PICTURES = ("masks", "regions", "video")


def check_outputs(configuration: Configuration, of_pictures: bool) -> None:
    """Raises UsageError for files that cannot be made of this kind of data."""
    settings = configuration.report
    if not of_pictures:
        for name in ONLY_OF_PICTURES:
            if getattr(settings, name):
                raise UsageError(
                    f"{flag_of(f'report.{name}')}: this data is no picture; leave it out"
                )
    for name in settings.export:
        if EXPORTS[name].of_pictures != of_pictures:
            able = [n for n, each in EXPORTS.items() if each.of_pictures == of_pictures]
            kind = "tracks in pictures" if of_pictures else "data that is no picture"
            raise UsageError(f"--export {name}: not of {kind}; choose {' or '.join(able)}")
