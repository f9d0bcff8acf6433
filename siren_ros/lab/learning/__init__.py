"""Gymnasium and PettingZoo environments in which drivers learn; the import registers them."""

from siren_ros.lab.learning.registration import parallel_env as parallel_env
from siren_ros.lab.learning.registration import register_environments

__all__ = ["parallel_env"]

register_environments()
