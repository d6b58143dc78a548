#include "controller/devices/cnc_device.h"

#include <iterator>

namespace reforge {

namespace {
constexpr std::string_view kNames[] = {"unknown", "Idle", "Run",   "Hold:1", "Hold:0", "Jog",
                                       "Home",    "Door", "Alarm", "Check",  "Sleep",  "Tool"};
static_assert(std::size(kNames) == static_cast<std::size_t>(CncRunState::kTool) + 1);
}  // namespace

std::string_view name(CncRunState state) {
  return kNames[static_cast<std::size_t>(state)];
}

}  // namespace reforge
