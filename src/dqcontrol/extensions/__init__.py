"""What users and other packages add: functions in their own files, and kinds of laws, plants and references."""
