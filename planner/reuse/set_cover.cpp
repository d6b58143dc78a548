#include "planner/reuse/set_cover.h"

#include <glpk.h>

#include <algorithm>
#include <cassert>

namespace reforge {

std::vector<std::size_t> cheapest_cover(std::size_t universe, const std::vector<CoverSet>& sets) {
  std::vector<std::vector<int>> having(universe);  // by element: columns, from 1
  for (std::size_t j = 0; j < sets.size(); ++j) {
    for (const auto element : sets[j].elements) {
      assert(element < universe);
      having[element].push_back(static_cast<int>(j) + 1);
    }
  }
  glp_term_out(GLP_OFF);
  glp_prob* problem = glp_create_prob();
  glp_set_obj_dir(problem, GLP_MIN);
  if (!sets.empty()) glp_add_cols(problem, static_cast<int>(sets.size()));
  for (std::size_t j = 0; j < sets.size(); ++j) {
    const int column = static_cast<int>(j) + 1;
    glp_set_col_kind(problem, column, GLP_BV);
    // A trifle per plane decides between equals: fewer planes, then lower numbers.
    glp_set_obj_coef(problem, column, sets[j].weight + 1e-6 + 1e-12 * static_cast<double>(j));
  }
  bool anything = false;
  for (const auto& columns : having) {
    if (columns.empty()) continue;
    anything = true;
    const int row = glp_add_rows(problem, 1);
    glp_set_row_bnds(problem, row, GLP_LO, 1, 0);
    std::vector<int> indices{0};
    indices.insert(indices.end(), columns.begin(), columns.end());
    const std::vector<double> ones(indices.size(), 1);
    glp_set_mat_row(problem, row, static_cast<int>(columns.size()), indices.data(), ones.data());
  }
  std::vector<std::size_t> chosen;
  if (anything) {
    glp_iocp options;
    glp_init_iocp(&options);
    options.presolve = GLP_ON;
    options.msg_lev = GLP_MSG_OFF;
    const int failed = glp_intopt(problem, &options);
    assert(failed == 0);  // a cover by all sets exists, and there is no time limit
    static_cast<void>(failed);
    for (std::size_t j = 0; j < sets.size(); ++j) {
      if (glp_mip_col_val(problem, static_cast<int>(j) + 1) > 0.5) chosen.push_back(j);
    }
  }
  glp_delete_prob(problem);
  return chosen;
}

}  // namespace reforge
