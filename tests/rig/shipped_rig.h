// The shipped rig, for tests of the virtual one.
#pragma once

#include <cstdlib>
#include <iostream>

#include "protocols/rig.h"

namespace reforge {

inline RigDescription shipped_rig() {
  const auto rig = read_rig(REFORGE_SOURCE_DIR "/config/rigs/mx220.json");
  if (!rig.ok()) {
    std::cerr << rig.error().sentence << '\n';
    std::abort();
  }
  return *rig;
}

}  // namespace reforge
