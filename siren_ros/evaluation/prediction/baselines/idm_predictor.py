"""IDM as a trajectory predictor: every vehicle follows its present leader along its lane."""

from dataclasses import dataclass, field

import numpy as np

from siren_ros.evaluation.prediction.baselines.idm import IdmConfig, idm_travel
from siren_ros.evaluation.prediction.baselines.lane_following import paths_from
from siren_ros.evaluation.prediction.baselines.leaders import leaders_of
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.predictor import PredictorOptions
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow, future_times_s
from siren_ros.judging.lane_location import locate
from siren_ros.roads.road_network import NO_LANE


@dataclass(frozen=True)
class IdmPredictor:
    """Car following on the lane's path, the leader at constant velocity, the desired speed max(v, speed limit).

    A vehicle keeps its present offset from the lane's centre line, so that the prediction starts at its position.
    A vehicle in no lane goes straight ahead. The predictor knows neither routes nor signals.
    """

    config: IdmConfig = field(default_factory=IdmConfig)
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """One hypothesis for each sample."""
        actors, config, times_s = batch.actors, self.config, future_times_s()
        places = locate(batch.network, actors.xy_m[:, -1], actors.yaw_rad[:, -1], actors.sumo_lane)
        lane = places.lane[batch.target]
        in_lane = lane != NO_LANE
        paths = paths_from(batch.network, np.unique(lane[in_lane]), config.range_m)
        leaders = leaders_of(batch, places, paths, config.range_m)
        limit = np.array([found.speed_limit_mps for found in batch.network.lanes] + [config.off_lane_limit_mps])
        speed = np.hypot(batch.velocity_mps[:, 0], batch.velocity_mps[:, 1])
        # NO_LANE is −1 and takes the last limit, that of vehicles in no lane.
        desired = np.maximum(speed, limit[lane])
        travelled = idm_travel(speed, desired, leaders.gap_m, leaders.speed_mps, times_s, config)
        heading = np.stack((np.cos(batch.yaw_rad), np.sin(batch.yaw_rad)), axis=-1)
        path = batch.xy_m[:, None] + travelled[..., None] * heading[:, None]
        rows = batch.target[in_lane]
        arc_m = places.arc_m[rows, None] + travelled[in_lane]
        path[in_lane] = paths.points(paths.path_of_lane[lane[in_lane]], arc_m, places.offset_m[rows])
        return Hypotheses.certain(path)


def make(options: PredictorOptions) -> IdmPredictor:
    """The constructor of the table of predictors."""
    del options
    return IdmPredictor()
