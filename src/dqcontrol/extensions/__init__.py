"""Extensions: functions in users' own files, and kinds of laws, plants and references of other packages."""

POLICY = "DQCONTROL_CODE"  # in the environment, so that worker processes have it too
REFUSED = "refused"  # here, as the command line sets it before anything heavy is loaded
