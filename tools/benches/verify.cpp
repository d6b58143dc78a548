// `tools/bench verify`: how fast the verifier simulates, what it needs, and what it finds.
//
//   bench-verify speed              moves a second, cost against swept length
//   bench-verify large              a part that fills the machine: time and memory
//   bench-verify mutants [PLACES]   single faults in good programs, judged by brute force (50)
//   bench-verify JOB...             job folders: time and memory of each
// Without arguments: speed, large, and mutants at 5 places. Seconds are of processor time.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <map>
#include <numbers>

#include "planner/verify/block_stock.h"
#include "tests/planner/verify_mutants.h"
#include "tests/planner/verify_reference.h"

namespace reforge {
namespace {

double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

// What a piece of work takes, in a process of its own.
template <typename Work>
void measured(const char* name, const Work& work) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    work();
    std::fflush(stdout);
    _exit(0);
  }
  int status = 0;
  rusage usage{};
  wait4(child, &status, 0, &usage);
  std::printf("%s: %.1f s of processor time, %.0f MiB at most%s\n", name,
              static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                  1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec),
              static_cast<double>(usage.ru_maxrss) / 1024, status == 0 ? "" : " (it FAILED)");
}

// A program that mills (or prints) a spiral of `moves` moves of about `step` mm over a slab.
std::string spiral(bool print, int moves, double step, double radius) {
  std::string text = "G21 G90\nG0 Z100\nG0 B0 C0\n";
  char line[96];
  const double x0 = print ? -90 : 0, z0 = print ? 25.2 : 19.4;
  if (print) text += "M70\n";
  if (!print) text += "M3 S12000\nG4 P2\n";
  std::snprintf(line, sizeof line, "G0 X%.3f Y0\nG0 Z%.3f\n", x0 + 2, z0);
  text += line;
  if (print) text += "M72 P0.3465\n";
  // An Archimedean spiral in and out again, a little lower (or higher) each time; milling begins
  // again from the top after 24 passes.
  const double pitch = print ? 0.5 : 1.2;
  double angle = 2 / pitch * 2 * std::numbers::pi, z = z0;
  double way = 1;
  int passes = 0;
  for (int k = 0; k < moves; ++k) {
    const double r = pitch * angle / (2 * std::numbers::pi);
    if ((r > radius && way > 0) || (r < 2 && way < 0)) {
      way = -way;
      ++passes;
      z = z0 + (print ? 0.2 * passes : -0.5 * (passes % 24));
    }
    angle += way * step / r;
    const double at = pitch * angle / (2 * std::numbers::pi);
    std::snprintf(line, sizeof line, "G1 X%.3f Y%.3f Z%.3f%s\n", x0 + at * std::cos(angle),
                  at * std::sin(angle), z, k == 0 ? (print ? " F500" : " F800") : "");
    text += line;
  }
  text += print ? "M73\nM74\nM75\nG0 Z100\nM71\nM30\n" : "G0 Z100\nM5\nM30\n";
  return text;
}

double replay_seconds(bool print, int moves, double step, double radius) {
  VerifyInputs inputs;
  inputs.rig = mutation::shipped_rig();
  inputs.initial = make_box({-30, -30, 0}, {30, 30, 20});
  inputs.fixture = make_box({-25, -25, -50}, {25, 25, 0});
  const std::string program = spiral(print, moves, step, radius);
  const double begin = cpu_seconds();
  const Verification v = mutation::verify_pair(inputs, program, 0.1);
  const double seconds = cpu_seconds() - begin;
  if (v.program.moves < static_cast<std::size_t>(moves)) {
    std::printf("the program was not simulated:\n%s", mutation::findings_of(v).c_str());
    std::exit(4);
  }
  return seconds;
}

void speed() {
  std::printf("moves a second at 0.1 mm, 3 mm ball, moves of 0.5 mm on a 60 x 60 x 20 mm block\n");
  for (const bool print : {false, true}) {
    const int few = 20000, many = print ? 420000 : 220000;
    const double a = replay_seconds(print, few, 0.5, 28), b = replay_seconds(print, many, 0.5, 28);
    std::printf("  %s: %.0f a second (%.2f s for %d, %.2f s for %d: the rest is fixed)\n",
                print ? "deposition" : "milling   ", (many - few) / (b - a), a, few, b, many);
  }
  std::printf("cost against swept length (milling, moves of 2 mm)\n");
  double sum_xy = 0, sum_xx = 0, mean_x = 0, mean_y = 0;
  std::vector<std::pair<double, double>> points;
  const double fixed = replay_seconds(false, 10, 2, 28);
  for (const int moves : {10000, 20000, 40000, 80000}) {
    const double seconds = replay_seconds(false, moves, 2, 28) - fixed;
    std::printf("  %6.0f mm: %.2f s\n", 2.0 * moves, seconds);
    points.push_back({std::log(moves), std::log(seconds)});
    mean_x += points.back().first / 4, mean_y += points.back().second / 4;
  }
  for (const auto& [x, y] : points) {
    sum_xy += (x - mean_x) * (y - mean_y);
    sum_xx += (x - mean_x) * (x - mean_x);
  }
  std::printf("  cost grows as length to the power of %.2f\n", sum_xy / sum_xx);
}

// 220 x 120 x 200 mm, faced from above and milled from two more sides, at 0.1 mm.
void large() {
  measured("a part of 220 x 120 x 200 mm at 0.1 mm", [] {
    VerifyInputs inputs;
    inputs.rig = mutation::shipped_rig();
    inputs.mode = Mode::kPaper;  // the machine's travel is no longer in the way
    inputs.initial = make_box({-110, -60, 0}, {110, 60, 200});
    inputs.target = inputs.reused = make_box({-109, -60, 0}, {109, 60, 199});
    std::string text = "G21 G90\nM3 S12000\nG4 P2\n";
    char line[96];
    const auto raster = [&](const char* turn, double half_x, double half_y, double z) {
      text += "G0 Z400\n";
      text += turn;
      std::snprintf(line, sizeof line, "G0 X%.3f Y%.3f\nG0 Z%.3f\n", -half_x, -half_y, z);
      text += line;
      int way = 1;
      for (double y = -half_y; y <= half_y; y += 1.0, way = -way) {
        std::snprintf(line, sizeof line, "G1 Y%.3f F800\nG1 X%.3f\n", y, way * half_x);
        text += line;
      }
    };
    raster("G0 B0 C0\n", 113, 63, 199);
    // Tilted by 90 about an axis 10 mm below the base, x takes the place of -z - 10.
    const auto side = [&](const char* turn, double sign) {
      text += "G0 Z400\n";
      text += turn;
      int way = 1;
      std::snprintf(line, sizeof line, "G0 X%.3f Y-63\nG0 Z99\n", sign * -213);
      text += line;
      for (double x = 213; x >= 10; x -= 1.0, way = -way) {
        std::snprintf(line, sizeof line, "G1 X%.3f F800\nG1 Y%d\n", -sign * x, way * 63);
        text += line;
      }
    };
    side("G0 B90 C0\n", 1);
    side("G0 B-90 C0\n", -1);
    text += "G0 Z400\nM5\nM30\n";
    const Verification v = mutation::verify_pair(inputs, text, 0);
    std::printf("  columns of %.2f mm; removed %.0f of %.0f mm3; %zu moves\n%s", v.pitch_mm,
                v.part.removed, 220.0 * 120 * 200 - 218.0 * 120 * 199, v.program.moves,
                mutation::findings_of(v).c_str());
  });
}

struct Tally {
  int made = 0, found = 0, harmless = 0, missed = 0;
};

int mutants(std::size_t places) {
  using namespace mutation;
  std::map<std::string, Tally> tallies;
  std::vector<std::string> missed;
  for (const Recipe& recipe : recipes()) {
    const SmallPair pair = make_pair(recipe);
    const Verification good = verify_pair(pair.inputs, pair.program, 0.1);
    const Box3 room = room_of(pair.inputs);
    const ReferenceOutcome expected = Reference(pair.inputs, room).run(pair.program);
    std::printf("%s: %zu lines, %s, reference %s\n", recipe.name.c_str(),
                lines_of(pair.program).size(), good.pass ? "no finding" : "FINDINGS",
                expected.broken.empty() ? "agrees" : expected.broken.c_str());
    for (const Kind& kind : kinds()) {
      Tally& tally = tallies[kind.name];
      each_mutant(pair, kind, places, [&](const Mutant& mutant, std::size_t place) {
        ++tally.made;
        if (!verify_pair(mutant.inputs, mutant.program, 0.1).pass) {
          ++tally.found;
          return;
        }
        const ReferenceOutcome is =
            Reference(mutant.inputs, room).run(mutant.program, kind.turn ? nullptr : &expected);
        const std::string why = change(expected, is);
        ++(why.empty() ? tally.harmless : tally.missed);
        if (!why.empty()) {
          missed.push_back(recipe.name + ", " + kind.name + " at " + std::to_string(place) + ": " +
                           why);
        }
      });
    }
  }
  Tally sum;
  std::printf("\n%-26s %6s %6s %9s %7s\n", "fault", "made", "found", "harmless", "missed");
  for (const Kind& kind : kinds()) {
    const Tally& t = tallies[kind.name];
    std::printf("%-26s %6d %6d %9d %7d\n", kind.name.c_str(), t.made, t.found, t.harmless,
                t.missed);
    sum.made += t.made, sum.found += t.found;
    sum.harmless += t.harmless, sum.missed += t.missed;
  }
  std::printf("%-26s %6d %6d %9d %7d\n", "all", sum.made, sum.found, sum.harmless, sum.missed);
  for (const std::string& text : missed) std::printf("missed: %s\n", text.c_str());
  return sum.missed == 0 ? 0 : 1;
}

void job(const char* folder) {
  measured(folder, [&] {
    const Result<JobVerification> v = verify_job(folder, {});
    if (!v) {
      std::printf("%s\n", v.error().sentence.c_str());
      _exit(3);
    }
    std::printf("  %s, %zu lines, %zu moves, %d blocks, columns of %.2f mm\n",
                v->certificate.pass ? "PASS" : "FAIL", v->certificate.lines, v->certificate.moves,
                v->certificate.blocks, v->certificate.pitch_mm);
  });
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  using namespace reforge;
  if (argc < 2) {
    speed();
    large();
    return mutants(5);
  }
  if (std::strcmp(argv[1], "speed") == 0) return speed(), 0;
  if (std::strcmp(argv[1], "large") == 0) return large(), 0;
  if (std::strcmp(argv[1], "mutants") == 0) {
    return mutants(argc > 2 ? std::strtoul(argv[2], nullptr, 10) : 50);
  }
  for (int k = 1; k < argc; ++k) job(argv[k]);
  return 0;
}
