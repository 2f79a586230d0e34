// A double for tests: it makes one controller.
#pragma once
#define PLUGINLIB_EXPORT_CLASS(type, base) \
  base* make_controller() { return new type(); }
