#include "tools/rig/cnc_controller.h"

#include "tools/rig/grbl_controller.h"
#include "tools/rig/marlin_controller.h"
#include "tools/rig/panel_controller.h"

namespace reforge {

std::unique_ptr<CncController> make_cnc(const RigDescription& rig, bool homed, bool hold_input) {
  switch (rig.cnc.dialect) {
    case CncDialect::kMarlin:
      return std::make_unique<MarlinController>(rig, homed, hold_input);
    case CncDialect::kFanuc:
      return std::make_unique<PanelController>(rig, homed, hold_input);
    case CncDialect::kGrbl:
      break;
  }
  return std::make_unique<GrblController>(rig, homed, hold_input);
}

}  // namespace reforge
