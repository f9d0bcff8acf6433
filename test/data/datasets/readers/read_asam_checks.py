"""Runs all checks of ASAM's checker bundle for OpenDRIVE or OpenSCENARIO on one file, as its own program does."""

import importlib
import json
import logging
import sys

from qc_baselib import Configuration, Result

package, file = sys.argv[1:3]
logging.disable()
main = importlib.import_module(f"{package}.main")
config, result = Configuration(), Result()
config.set_config_param("InputFile", file)
result.register_checker_bundle(name=main.constants.BUNDLE_NAME, description="", version="1.0.0", summary="")
result.set_result_version(version="1.0.0")
main.run_checks(config, result)
(bundle,) = result.get_checker_bundle_results()
answer = {
    "statuses": {checker.checker_id: checker.status.value for checker in bundle.checkers},
    "issues": [
        [
            checker.checker_id,
            issue.level.name,
            "; ".join(place.description or issue.description for place in issue.locations),
        ]
        for checker in bundle.checkers
        for issue in checker.issues
    ],
}
print(json.dumps(answer))
