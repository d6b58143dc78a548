// An extruder board that does what a test tells it, and keeps what reached it.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "tools/rig/extruder_board.h"

namespace reforge {

struct FakeBoardState {
  int64_t now = 0;
  int resets = 0;
  std::string received;
  std::string to_send;
  std::vector<FilamentStep> steps;  // due when their time has come
  bool permitted = true;
  bool ready = true;
  CncOutputs wired;
  std::vector<BoardMishap> suffered;
  double nozzle_c = 22;
};

class FakeBoard final : public ExtruderBoard {
 public:
  explicit FakeBoard(FakeBoardState& state) : state_(state) {}
  void advance_to(int64_t ns) override { state_.now = ns; }
  void receive(std::string_view bytes) override { state_.received += bytes; }
  std::string take_transmitted() override { return std::exchange(state_.to_send, {}); }
  int64_t last_transmit_start_ns() const override { return state_.now; }
  void reset() override { ++state_.resets; }
  int resets_by_itself() const override { return 0; }
  bool crashed() const override { return false; }
  void suffer(BoardMishap mishap) override { state_.suffered.push_back(mishap); }
  bool ready() const override { return state_.ready; }
  void set_cnc_outputs(const CncOutputs& outputs) override { state_.wired = outputs; }
  std::vector<FilamentStep> take_steps() override {
    std::vector<FilamentStep> due;
    while (!state_.steps.empty() && state_.steps.front().ns <= state_.now) {
      due.push_back(state_.steps.front());
      state_.steps.erase(state_.steps.begin());
    }
    return due;
  }
  bool run_permitted() const override { return state_.permitted; }
  bool module_open() const override { return false; }
  double nozzle_c() override { return state_.nozzle_c; }

 private:
  FakeBoardState& state_;
};

}  // namespace reforge
