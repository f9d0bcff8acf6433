"""Which parameter files an episode is made from, without making it."""

from siren_ros.dynamics.parameters import load_vehicle_parameters
from siren_ros.params.input_files import FILES_ON_DISK, InputFile, InputFiles, NotedFiles
from siren_ros.scenario.presets import load_preset
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.scenario.templates import load_template
from siren_ros.sensors.suite.look_file import load_look
from siren_ros.sensors.suite.suite import load_suite
from siren_ros.traffic.demand.driver_models import load_drivers


def files_of_request(request: EpisodeRequest, files: InputFiles = FILES_ON_DISK) -> tuple[InputFile, ...]:
    """The files that ``set_up_episode`` reads and puts into the episode's description.

    Raises:
        InputError: One of them cannot be used.
    """
    noted = NotedFiles(files)
    load_template(request.template, noted)
    load_preset(request.preset, noted)
    for suite in (request.sensors, request.av_sensors):
        load_suite(suite, noted)
    load_look(request.look, noted)
    load_vehicle_parameters(noted)
    load_drivers(files=noted)
    return noted.seen
