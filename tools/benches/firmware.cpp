// The extruder firmware under fire: fuzzed frames, seeded fault scripts, random command sequences,
// each on the logic compiled for the host and on the real ELF in simavr. Exit 1 if anything was
// wrong; what it was, and its seed, is printed.
//
//   tools/bench firmware [--frames N] [--scripts N] [--avr-scripts N] [--sequences N]
//                        [--avr-sequences N] [--seed S]
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <functional>
#include <random>
#include <string>

#include "tests/firmware/fault_world.h"
#include "tests/firmware/frame_storm.h"
#include "tests/firmware/step_sequences.h"

namespace {

using namespace reforge;

struct Amounts {
  int64_t frames = 1'000'000, scripts = 10'000, avr_scripts = 200;
  int64_t sequences = 1'000'000, avr_sequences = 10'000;
  uint64_t seed = 1;
};

double seconds_of(const std::function<void()>& work) {
  const auto begun = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

// Wrong ones, printed.
int64_t scripts(const char* where, int64_t count, uint64_t seed, const RigDescription& rig,
                const std::function<std::unique_ptr<TriedBoard>()>& make) {
  int64_t wrong = 0;
  ScriptOutcome sum;
  const double seconds = seconds_of([&] {
    for (int64_t i = 0; i < count; ++i) {
      const auto board = make();
      const uint64_t script = seed * 1'000'000 + static_cast<uint64_t>(i);
      const ScriptOutcome outcome = run_fault_script(*board, rig, script);
      if (outcome.wrong) {
        ++wrong;
        std::printf("  script %llu: %s\n", static_cast<unsigned long long>(script),
                    outcome.wrong->c_str());
      }
      sum.faults += outcome.faults;
      sum.orders += outcome.orders;
      sum.steps += outcome.steps;
      sum.virtual_ms += outcome.virtual_ms;
    }
  });
  std::printf(
      "%s: %lld fault scripts, %lld wrong; %lld faults, %lld orders, %lld steps, %.1f virtual "
      "hours "
      "in %.0f s\n",
      where, static_cast<long long>(count), static_cast<long long>(wrong),
      static_cast<long long>(sum.faults), static_cast<long long>(sum.orders),
      static_cast<long long>(sum.steps), static_cast<double>(sum.virtual_ms) / 3.6e6, seconds);
  std::fflush(stdout);
  return wrong;
}

int64_t sequences(const char* where, int64_t count, uint64_t seed,
                  const std::function<std::unique_ptr<SteppedBoard>()>& make) {
  SequenceOutcome outcome;
  const double seconds = seconds_of([&] {
    const auto board = make();
    outcome = run_step_sequences(*board, count, seed);
  });
  std::printf("%s: %lld command sequences, %lld wrong; %lld orders, %lld steps in %.0f s\n", where,
              static_cast<long long>(count), static_cast<long long>(outcome.wrong),
              static_cast<long long>(outcome.orders), static_cast<long long>(outcome.steps),
              seconds);
  if (outcome.wrong > 0) std::printf("  first: %s\n", outcome.first.c_str());
  std::fflush(stdout);
  return outcome.wrong;
}

}  // namespace

int main(int argc, char** argv) {
  Amounts n;
  CLI::App app{"The extruder firmware under fire"};
  app.add_option("--frames", n.frames, "Fuzzed frames, on the host")->capture_default_str();
  app.add_option("--scripts", n.scripts, "Fault scripts, on the host")->capture_default_str();
  app.add_option("--avr-scripts", n.avr_scripts, "Fault scripts, in simavr")->capture_default_str();
  app.add_option("--sequences", n.sequences, "Command sequences, on the host")
      ->capture_default_str();
  app.add_option("--avr-sequences", n.avr_sequences, "Command sequences, in simavr")
      ->capture_default_str();
  app.add_option("--seed", n.seed)->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  const auto rig = read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
  if (!rig) {
    std::fprintf(stderr, "%s\n", rig.error().sentence.c_str());
    return 3;
  }
  if (!avr_board(REFORGE_FIRMWARE_ELF)) {
    std::fprintf(stderr, "The firmware %s cannot be loaded.\n", REFORGE_FIRMWARE_ELF);
    return 3;
  }
  int64_t wrong = 0;
  FrameOutcome storm;
  const double seconds = seconds_of([&] { storm = run_frame_storm(n.frames, n.seed); });
  std::printf("host: %lld fuzzed frames (%lld valid, %lld orders taken), %lld wrong in %.0f s\n",
              static_cast<long long>(storm.frames), static_cast<long long>(storm.valid),
              static_cast<long long>(storm.taken), static_cast<long long>(storm.wrong), seconds);
  if (storm.wrong > 0) std::printf("  first: %s\n", storm.first.c_str());
  std::fflush(stdout);
  wrong += storm.wrong;
  wrong += sequences("host", n.sequences, n.seed, [] { return stepped_logic(); });
  wrong += scripts("host", n.scripts, n.seed, *rig, [] { return logic_board(); });
  wrong += sequences("simavr", n.avr_sequences, n.seed,
                     [] { return stepped_avr(REFORGE_FIRMWARE_ELF); });
  wrong += scripts("simavr", n.avr_scripts, n.seed, *rig,
                   [] { return avr_board(REFORGE_FIRMWARE_ELF); });
  return wrong == 0 ? 0 : 1;
}
