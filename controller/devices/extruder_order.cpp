#include "controller/devices/extruder_order.h"

#include <cmath>
#include <cstdio>

#include "protocols/extruder_wire.h"

namespace reforge {

namespace {
std::int32_t rounded(double value) {
  return static_cast<std::int32_t>(std::lround(value));
}
}  // namespace

std::int32_t wire_argument(const ExtruderOrder& order) {
  if (order.m_code == 70) return rounded(order.argument * 10);
  if (order.m_code == 72 || order.m_code == 74) return rounded(order.argument * 1000);
  return wire::kUseSetting;
}

std::string to_string(const ExtruderOrder& order) {
  char text[32];
  const char* format = order.m_code == 70                         ? "M%d S%.1f"
                       : order.m_code == 72 || order.m_code == 74 ? "M%d P%.4f"
                                                                  : "M%d";
  std::snprintf(text, sizeof text, format, order.m_code, order.argument);
  return text;
}

}  // namespace reforge
