// Seconds of wall and processor time by stage of the chain, in the order the stages first ran.
#pragma once

#include <chrono>
#include <ctime>
#include <string>
#include <vector>

namespace reforge {

struct StageTime {
  std::string stage;  // load setup volumes init search blocks toolpaths program verify total
  double seconds = 0;
  double cpu_seconds = 0;  // of all threads
};

struct StageTimes {
  std::vector<StageTime> stages;

  void add(const std::string& stage, double seconds, double cpu_seconds) {
    for (StageTime& entry : stages) {
      if (entry.stage != stage) continue;
      entry.seconds += seconds;
      entry.cpu_seconds += cpu_seconds;
      return;
    }
    stages.push_back({stage, seconds, cpu_seconds});
  }
};

// Adds the time from its making to its end.
class StageTimer {
 public:
  StageTimer(StageTimes& times, std::string stage) : times_(times), stage_(std::move(stage)) {}
  ~StageTimer() {
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start_;
    times_.add(stage_, wall.count(), cpu_now() - cpu_start_);
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  static double cpu_now() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

  StageTimes& times_;
  std::string stage_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double cpu_start_ = cpu_now();
};

}  // namespace reforge
