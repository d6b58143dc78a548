// Arbitrary text as a program on a small block: the verifier answers and never crashes or hangs.
#include <cstdint>
#include <sstream>
#include <string>

#include "planner/geometry/shapes.h"
#include "planner/verify/verify.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace reforge;
  static const VerifyInputs inputs = [] {
    VerifyInputs in;
    Result<RigDescription> rig =
        read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
    if (!rig) __builtin_trap();
    in.rig = std::move(*rig);
    in.initial = make_box({-3, -3, 0}, {3, 3, 4});
    in.fixture = make_box({-2, -2, -50}, {2, 2, 0});
    return in;
  }();
  std::istringstream program(std::string(reinterpret_cast<const char*>(data), size));
  VerifyOptions options;
  options.pitch_mm = 1.0;
  const Result<Verification> v = verify_program(program, inputs, options);
  if (v && v->pass != (v->findings.total() == 0)) __builtin_trap();
  return 0;
}
