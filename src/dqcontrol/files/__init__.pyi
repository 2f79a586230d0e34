from .yaml_file import read_yaml as read_yaml
