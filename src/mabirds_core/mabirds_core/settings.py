"""What all settings of an experiment file have in common."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Checked when read, never changed after; a misspelt name or a number that is none is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
