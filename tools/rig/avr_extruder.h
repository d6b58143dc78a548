// The real firmware in simavr (avr_board.h) as the virtual rig's extruder board.
#pragma once

#include <memory>

#include "tools/rig/avr_board.h"
#include "tools/rig/extruder_board.h"

namespace reforge {

class AvrExtruder final : public ExtruderBoard {
 public:
  explicit AvrExtruder(std::unique_ptr<AvrBoard> board) : board_(std::move(board)) {}

  void advance_to(int64_t ns) override { board_->advance_to(ns); }
  void receive(std::string_view bytes) override;
  std::string take_transmitted() override;
  int64_t last_transmit_start_ns() const override { return board_->last_transmit_start_ns(); }
  void reset() override { board_->reset(BoardReset::kButton); }
  int resets_by_itself() const override { return board_->resets_seen(); }
  bool crashed() const override { return board_->crashed(); }
  void suffer(BoardMishap mishap) override;
  std::vector<FilamentStep> take_steps() override;
  bool run_permitted() const override { return board_->outputs().run_permitted; }
  bool module_open() const override { return board_->outputs().module_relay; }
  bool ready() const override { return board_->outputs().ready; }
  void set_cnc_outputs(const CncOutputs& outputs) override;
  double nozzle_c() override { return board_->hot_end().block_c(); }

 private:
  std::unique_ptr<AvrBoard> board_;
  CncOutputs wired_;
};

}  // namespace reforge
