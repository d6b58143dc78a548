// The stock: the initial solid and everything the blocks did to it so far, in order.
//
// One body through milling and printing. It can be looked at along any direction (columns), at any
// time, at the price of casting the initial mesh and walking the layers; two kinds of material are
// kept apart: `original` (of M) and `deposited`. Part frame, mm.
#pragma once

#include <memory>
#include <variant>
#include <vector>

#include "planner/verify/layers.h"

namespace reforge::verify {

struct Material {
  Columns original;
  Columns deposited;
};

class Stock {
 public:
  explicit Stock(const TriangleMesh& initial) : initial_(initial) {}

  void add(CutLayer layer) { layers_.emplace_back(std::move(layer)); }
  void add(DepositLayer layer) { layers_.emplace_back(std::move(layer)); }

  // The material on every column of the view, as of now; large views by up to four threads. Where a
  // deposit was laid into original material both are reported.
  Material columns(const View& view) const;

  std::size_t layers() const { return layers_.size(); }
  std::size_t bytes() const;

 private:
  Material rows(const View& view, const Columns& cast, int begin, int end) const;

  const TriangleMesh& initial_;  // outlives the stock
  std::vector<std::variant<CutLayer, DepositLayer>> layers_;
};

}  // namespace reforge::verify
