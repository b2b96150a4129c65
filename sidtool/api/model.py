"""Models of scripts and notebooks."""

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile


class Model(ModelFile):
    """A flexible body: geometry, material, discretisation, reduction; a model file.

        model = sidtool.Model.load("rod_q4.toml")
        sid = model.with_({"geometry.thickness": 0.02}).convert()

    Raises
    ------
    InputError : names the argument, what was found and what was expected.
    """

    def convert(self) -> SID:
        """Convert the model to a SID.

        Raises
        ------
        InputError : the body cannot be discretised or reduced.
        """
        from .operations import convert

        return convert(self)

    def __repr__(self) -> str:
        parts = f"{self.geometry.type}, {self.discretisation.type}"
        return f"<Model {self.title!r}: {parts}, {self.reduction.method}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from ..report.input_files import model_parts

        return "".join(part.html for part in model_parts(self))
