"""What a recipe may say of the extras."""

from pathlib import Path

from pydantic import Field

from gmrdata.config import Config


class Extras(Config):
    """Who and what moves through the scene beside the clip's person.

    Their instance numbers go on from the person's 1: first the company, then the passers-by, then
    the cars.
    """

    company: int = Field(default=0, ge=0, le=2)
    """People who go along with the clip's person, about 0.9 to 1.5 m away, in view for at least
    four fifths of the frames."""
    passers_by: int = Field(default=0, ge=0, le=8)
    """People who cross the view once, in front of the clip's person or behind."""
    cars: int = Field(default=0, ge=0, le=2)
    """Cars that drive across the view at 3 to 8 m/s; not in a room."""
    motions: tuple[Path, ...] = ()
    """Motion files for the passers-by, each at least as long as the clip; none: embedded gaits."""

    @property
    def names(self) -> tuple[str, ...]:
        """Each extra's name, in the order of the instance numbers 2, 3, ..."""
        kinds = {"company": self.company, "passer_by": self.passers_by, "car": self.cars}
        return tuple(f"{kind}_{n + 1}" for kind, count in kinds.items() for n in range(count))

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the extras depend on, by name."""
        if not self.passers_by:
            return {}
        from gmrdata.motion.read import input_files  # scipy's splines; most recipes name none

        return {
            f"extras_{role}{number}": file
            for number, path in enumerate(self.motions)
            for role, file in input_files(path).items()
        }

    def with_full_paths(self) -> "Extras":
        """The same for a process that runs in another folder."""
        return self.model_copy(update={"motions": tuple(path.resolve() for path in self.motions)})
