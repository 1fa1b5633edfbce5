#include "diagnose/diagnose.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <opencv2/core/mat.hpp>

#include "compare/probability.h"
#include "diagnose/edge_registration.h"
#include "diagnose/last_step.h"
#include "diagnose/mask_fit.h"
#include "diagnose/plausibility.h"
#include "diagnose/score.h"
#include "diagnose/screen.h"
#include "diagnose/settle.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double leaves_something = 1.05;   // dispersion
constexpr double leaves_little = 1.3;       // dispersion up to which places and masks are looked after
constexpr double close_behind = 0.9;        // share of the best one's gain
constexpr double least_fall = 0.02;         // share of what is left of the held-out score
constexpr double unproven_fall = 0.25;      // of what an effect that had not proved itself has to take of that
constexpr double hardly_rises = 0.1;        // a score that stays as it is, where the proper one falls
constexpr double least_proper_gain = 0.01;  // an element
constexpr double far_worse = 0.5, far_worse_share = 0.05;  // of a held-out score, and of what is left of it

CandidateReport report_of(const Refined& refined, int null_count) {
  CandidateReport report;
  report.effect = refined.effect;
  report.id = refined.id;
  report.p = refined.p;
  report.null_count = null_count;
  report.evidence = refined.test_gain;
  report.train_gain = refined.train_gain;
  return report;
}

void fill_parameters(CandidateReport& report, const SensorModel& model, const Fit& fit,
                     const EffectCatalogue& catalogue) {
  const EffectInstance* instance = model.find(report.id);
  if (!instance) return;
  report.parameters.clear();
  for (const auto& parameter : fit.parameters)
    if (parameter.id == report.id) report.parameters.emplace_back(parameter, instance->values.at(parameter.name));
  for (const auto& spec : instance->declaration(catalogue).parameters) {  // whole numbers: without interval; maps
    const bool listed = std::any_of(report.parameters.begin(), report.parameters.end(),
                                    [&](const auto& entry) { return entry.first.name == spec.name; });
    const ParameterValue& value = instance->values.at(spec.name);
    if (listed || (spec.kind != ParameterKind::integer && spec.interpolate && !value.ci95)) continue;
    FitParameter parameter;
    parameter.id = report.id;
    parameter.name = spec.name;
    parameter.unit = spec.unit;
    report.parameters.emplace_back(parameter, value);
  }
}

/// The climb from the model given to one that explains the recording, effect by effect.
class Climb {
 public:
  Climb(const Experiment& experiment, const Measurement& measured, const SensorModel& model, const Hypotheses& all,
        const DiagnosisOptions& options, Diagnosis& diagnosis)
      : experiment_(experiment),
        measured_(measured),
        given_(model),
        all_(all),
        options_(options),
        diagnosis_(diagnosis),
        catalogue_(experiment.forward().catalogue()),
        motions_(scene_motions(experiment, model,
                               registration_prior(experiment.forward().set(), experiment.nominal(0).camera))) {
    rung_options_.simulations = options.simulations;
    rung_options_.converged_far_off = 0.01;
    rung_options_.seed = options.seed * 100000;
  }

  void run() {
    rungs_.push_back(fit_rung(experiment_, motions_, measured_, given_, {}, rung_options_));
    finish(rungs_[0]);
    added_.push_back("");
    // A fit that went astray says nothing of how strong the noise is.
    const SensorModel& near = rungs_[0].dispersion > search_options_.astray ? given_ : rungs_[0].model;
    book_.emplace(experiment_, signature_model(given_, near, catalogue_), all_,
                  SignatureOptions{.seed = options_.seed * 7001});
    std::vector<int> everyone(all_.tested.size());
    std::iota(everyone.begin(), everyone.end(), 0);
    book_->look_at(everyone, false);
    while (static_cast<int>(evidence_.accepted.size()) < options_.most_effects && step_up()) {
    }
    removed_.resize(rungs_.size());
    step_back();
    judge_last();
    report();
  }

 private:
  /// Where little is left, what is left may be the place of a target, a mask in the wrong valley or a fit that
  /// stopped half-way.
  void finish(Rung& rung) const {
    if (rung.dispersion > leaves_little) return;
    register_by_edges(experiment_, motions_, measured_, rung_options_, rung);
    fit_masks(experiment_, motions_, measured_, given_, rung_options_, rung);
    if (rung.dispersion <= leaves_something) settle_down(experiment_, motions_, measured_, rung_options_, rung);
  }

  /// What the rung's model still lacks: hypotheses and their signatures.
  std::pair<Hypotheses, std::vector<Signature>> left() const {
    std::pair<Hypotheses, std::vector<Signature>> result;
    std::vector<int> index(all_.tested.size(), -1);
    for (std::size_t h = 0; h < all_.tested.size(); ++h) {
      if (std::find(added_.begin(), added_.end(), all_.tested[h].effect) != added_.end()) continue;
      index[h] = static_cast<int>(result.first.tested.size());
      result.first.tested.push_back(all_.tested[h]);
    }
    for (const auto& signature : book_->signatures()) {
      if (index[signature.hypothesis] < 0) continue;
      result.second.push_back(signature);
      result.second.back().hypothesis = index[signature.hypothesis];
    }
    return result;
  }

  /// Simulates more settings of the hypotheses that explain something already.
  void look_closer(const Rung& rung) {
    constexpr double something = 6;  // gain of chi: a fifth of what is needed to be accepted
    looked_closely_.resize(all_.tested.size());
    std::vector<int> worth_it;
    const Ranking ranking(experiment_, rung, all_, book_->signatures());
    for (const LinearGain& found : ranking.gains(rung.rest, rung.nuisances)) {
      const int h = found.hypothesis;
      if (looked_closely_[h] || found.gain < something * rung.dispersion) continue;
      looked_closely_[h] = true;
      worth_it.push_back(h);
    }
    book_->look_at(worth_it, true);
  }

  /// Adds the best hypothesis and fits everything again; false if there is none, or if it lowers no held-out score.
  bool step_up() {
    const Rung& rung = rungs_.back();
    look_closer(rung);
    const auto [hypotheses, signatures] = left();
    const SearchResult found =
        search(experiment_, motions_, rung, measured_, hypotheses, signatures, *book_, search_options_);
    if (diagnosis_.ranking.empty())
      for (std::size_t h = 0; h < hypotheses.tested.size(); ++h)
        diagnosis_.ranking.push_back(
            {hypotheses.tested[h].effect, found.linear[h].gain / rung.dispersion, found.prices[h], found.p_values[h]});
    if (tracing()) {
      fmt::print(stderr, "step {} gate {:.1f} dispersion {:.2f}\n", rungs_.size() - 1, found.gate, rung.dispersion);
      for (const auto& r : found.refined)
        fmt::print(stderr, "  {} linear {:.1f} price {:.1f} train {:.1f} test {:.1f}\n", r.effect, r.linear_gain,
                   r.price, r.train_gain, r.test_gain);
    }
    diagnosis_.unconfirmed.clear();
    for (const Refined* candidate : found.unconfirmed(search_options_))
      diagnosis_.unconfirmed.push_back({candidate->effect, capture_name(candidate->shown_in)});
    auto worthy = found.accepted(search_options_);
    // What could not prove itself beside bent parameters is fitted with all of them, and judged by what that leaves.
    const bool unproven = worthy.empty();
    if (unproven) worthy = found.unproven(search_options_);
    if (worthy.empty()) return false;

    auto [best, next] = choose(rung, worthy);

    CandidateReport report = report_of(*best, static_cast<int>(rung.nulls.size()));
    Evidence::Accepted accepted{best->effect, false, best->random_map, {}};
    for (const auto& hypothesis : all_.tested)
      if (hypothesis.effect == best->effect) accepted.map = hypothesis.declaration->per_unit_map;
    for (const auto& rival : found.refined)
      if (rival.effect != best->effect && rival.test_gain > search_options_.least_test_gain &&
          std::find(accepted.rivals.begin(), accepted.rivals.end(), rival.effect) == accepted.rivals.end() &&
          confounded(rung, *best, rival))
        accepted.rivals.push_back(rival.effect);
    report.confounded_with = accepted.rivals;
    if (!accepted.rivals.empty()) seek_captures(report, rung, found, *best);

    finish(next);
    if (!climb(*best, std::move(next), accepted.map && accepted.map_looks_random, unproven)) return false;
    hold(*best, rung_options_);
    diagnosis_.candidates.push_back(report);
    evidence_.accepted.push_back(accepted);
    added_.push_back(best->effect);
    return true;
  }

  /// The one that is added, and the rung with it. The runner-up is tried, too, where the best leaves anything: a
  /// model's bent parameters may have favoured the wrong one.
  std::pair<const Refined*, Rung> choose(const Rung& rung, const std::vector<const Refined*>& worthy) const {
    const Refined* best = worthy[0];
    Rung next = with_added(rung, *best);
    const auto runner_up =
        std::find_if(worthy.begin(), worthy.end(), [&](const Refined* other) { return other->effect != best->effect; });
    if (next.dispersion <= leaves_something || runner_up == worthy.end() ||
        (*runner_up)->score() <= close_behind * best->score())
      return {best, std::move(next)};
    Rung other = with_added(rung, **runner_up);
    const double proper = proper_score(experiment_.layout(), next), its = proper_score(experiment_.layout(), other);
    if (tracing())
      fmt::print(stderr, "  {} dispersion {:.2f} proper {:.4f}, {} {:.2f} {:.4f}\n", best->effect, next.dispersion,
                 proper, (*runner_up)->effect, other.dispersion, its);
    if (its < proper) return {*runner_up, std::move(other)};
    return {best, std::move(next)};
  }

  /// Puts a rung on the ladder; false, and the ladder as it was, if that makes it no better. The gain was computed with
  /// the scale of the rung before; the ladder judges by the last one's. An addition that lowers neither the held-out
  /// score there nor the proper score is no improvement, whatever its gain said. Scores are of a typical unit: a map
  /// that was learned on train and came back on the captures held out (`by_its_map`) is not in them.
  bool climb(const Refined& best, Rung next, bool by_its_map, bool unproven) {
    rungs_.push_back(std::move(next));
    double before = 0, after = 0;
    const auto improves = [&] {
      const Rung &last = rungs_.back(), &previous = rungs_[rungs_.size() - 2];
      const double proper = proper_score(experiment_.layout(), last),
                   proper_before = proper_score(experiment_.layout(), previous);
      const auto judged = scores(experiment_.layout(), last, measured_.all, rungs_);
      before = judged[judged.size() - 2].heldout, after = judged.back().heldout;
      if (tracing())
        fmt::print(stderr, "  {} added: held-out {:.4f} -> {:.4f}, proper {:.4f} -> {:.4f}\n", best.effect, before,
                   after, proper_before, proper);
      const double excess = std::max(0.0, before - 1);
      // Below the floor chance moves the held-out score up and down; what the proper one gets worse by counts there.
      const bool gets_worse = excess == 0 && proper >= proper_before + least_proper_gain;
      const bool falls = !gets_worse && after <= before - (unproven ? unproven_fall : least_fall) * excess;
      const bool falls_properly =
          proper <= proper_before - least_proper_gain && after < before + std::max(hardly_rises, least_fall * excess);
      return falls || (!unproven && (by_its_map || falls_properly));
    };
    if (improves()) return true;
    // What is weak hardly bent the others: beginning anew may have cost more than it gains.
    rungs_.back() = with_added(rungs_[rungs_.size() - 2], best, false);
    if (improves()) return true;
    diagnosis_.warnings.push_back(
        fmt::format("{} was tried next and taken out again: with it the error on captures held out did not fall "
                    "({:.3g} to {:.3g})",
                    best.effect, before, after));
    rungs_.pop_back();
    return false;
  }

  /// Captures that would tell an effect from all of those that it is confounded with; if there are none, from the
  /// first.
  void seek_captures(CandidateReport& report, const Rung& rung, const SearchResult& found, const Refined& best) const {
    constexpr std::size_t most = 3;
    report.sought_captures = true;
    report.told_from = report.confounded_with;
    for (;;) {
      std::vector<SensorModel> rivals;
      for (const std::string& name : report.told_from)
        rivals.push_back(std::find_if(found.refined.begin(), found.refined.end(), [&](const Refined& r) {
                           return r.effect == name;
                         })->model);
      report.would_separate =
          captures_that_separate(experiment_, motions_, rung, best.model, rivals, options_.seed * 3001);
      report.would_separate.resize(std::min(report.would_separate.size(), most));
      if (!report.would_separate.empty() || rivals.size() == 1) return;
      report.told_from.resize(1);
    }
  }

  /// The rung's model with a hypothesis added, everything fitted again. What the model had before was bent to make up
  /// for what was missing: it begins anew where the user put it, or stays where it is.
  Rung with_added(const Rung& rung, const Refined& hypothesis, bool anew = true) const {
    RungOptions options = rung_options_;
    options.added = hypothesis.id;
    options.narrow = narrow_of(rung.fit.parameters);
    hold(hypothesis, options);
    SensorModel start = hypothesis.model;
    if (anew)
      for (auto& instance : start.effects)
        if (const EffectInstance* given = given_.find(instance.id)) instance.values = given->values;
    return fit_rung(experiment_, motions_, measured_, start, anew ? std::vector<Offset>{} : rung.offsets, options);
  }

  /// What a map said of an effect's parameters stays.
  static void hold(const Refined& hypothesis, RungOptions& options) {
    if (!hypothesis.given_by_map) return;
    for (const auto& [name, value] : hypothesis.model.find(hypothesis.id)->values)
      if (value.ci95) options.fixed.push_back(hypothesis.id + "." + name);
  }

  /// Does a model miss the captures held out by so much more than the last one that no fit would bring it back?
  bool is_far_worse(const Rung& unfitted) const {
    const auto judged = scores(experiment_.layout(), rungs_.back(), measured_.all, {rungs_.back(), unfitted});
    const double with = judged[0].heldout, without = judged[1].heldout;
    if (tracing()) fmt::print(stderr, "  unfitted: held-out {:.3f}, without {:.3f}\n", with, without);
    return without > with + far_worse + far_worse_share * std::max(0.0, with - 1);
  }

  /// What was needed on the way may be superfluous beside what was added later. The last one just proved itself.
  void step_back() {
    for (std::size_t k = 0; k + 1 < diagnosis_.candidates.size();) {
      SensorModel without = rungs_.back().model;
      const std::string id = diagnosis_.candidates[k].id;
      std::erase_if(without.effects, [&](const EffectInstance& e) { return e.id == id; });
      RungOptions again = rung_options_;
      again.simulations = 8;  // only their mean is looked at
      again.passes = 1;
      again.iterations = 4;
      again.narrow = narrow_of(rungs_.back().fit.parameters);
      const auto& offsets = rungs_.back().offsets;
      // The last rung's metric lets all other parameters make up for it to first order.
      if (is_far_worse(unfitted_rung(experiment_, motions_, measured_, without, offsets, again))) {
        ++k;
        continue;
      }
      std::vector<Rung> pair{rungs_.back(), fit_rung(experiment_, motions_, measured_, without, offsets, again)};
      const auto judged = scores(experiment_.layout(), pair[0], measured_.all, pair);
      if (tracing())
        fmt::print(stderr, "  without {}: held-out {:.3f} -> {:.3f}\n", id, judged[0].heldout, judged[1].heldout);
      if (judged[1].heldout > judged[0].heldout) {
        ++k;
        continue;
      }
      diagnosis_.warnings.push_back(fmt::format(
          "{} was added and, with what came after it, taken out again: without it the error on captures held out is no "
          "larger ({:.3g} with it, {:.3g} without)",
          diagnosis_.candidates[k].effect, judged[0].heldout, judged[1].heldout));
      rungs_.push_back(std::move(pair[1]));
      added_.push_back("");
      removed_.push_back(diagnosis_.candidates[k].effect);
      diagnosis_.candidates.erase(diagnosis_.candidates.begin() + static_cast<long>(k));
      evidence_.accepted.erase(evidence_.accepted.begin() + static_cast<long>(k));
    }
  }

  /// Is anything left that the last model's own randomness does not explain?
  void judge_last() {
    std::set<std::string> unexplained;
    auto fits = goodness_of_fit(experiment_.layout(), rungs_.back());
    leave_to_train_what_it_never_saw(fits);
    for (const auto& fit : fits) {
      if (tracing())
        fmt::print(stderr, "goodness {:14} {} {:.3f} excess {:.3f} +- {:.3f}{}\n", fit.segment,
                   fit.train ? "train" : "test", fit.ratio, fit.excess, fit.spread, fit.significant() ? " *" : "");
      if (!fit.significant() || !unexplained.insert(fit.segment).second) continue;
      Unexplained entry;
      entry.channel = fit.group;
      entry.segment = fit.segment;
      entry.ratio = fit.ratio;
      if (fit.segment == "intrinsics") entry.shape = wanted_intrinsics();
      diagnosis_.unexplained.push_back(entry);
    }
    evidence_.unexplained_segments.assign(unexplained.begin(), unexplained.end());
    diagnosis_.verdict = judge(evidence_);
    screen(experiment_, rungs_.back(), measured_.all, diagnosis_.unexplained);
  }

  /// What stands out on captures held out alone may be a mask of which train says too little: no finding.
  void leave_to_train_what_it_never_saw(std::vector<SegmentFit>& fits) {
    const auto stands_out = [&](bool train) {
      return std::any_of(fits.begin(), fits.end(),
                         [&](const SegmentFit& fit) { return fit.train == train && fit.significant(); });
    };
    if (stands_out(true) || !stands_out(false)) return;
    const auto mask =
        mask_that_may_stand_elsewhere(experiment_, motions_, measured_, given_, rung_options_, rungs_.back());
    if (!mask) return;
    std::string captures;
    for (const int c : captures_that_stand_out(experiment_.layout(), rungs_.back()))
      if (!experiment_.layout().train[c]) captures += (captures.empty() ? "" : ", ") + capture_name(c);
    diagnosis_.warnings.push_back(fmt::format(
        "captures held out show drop-outs that those fitted to say too little of to expect ({}): with {} nearer to "
        "where "
        "the model given has it, all captures are as they should be. Record more such targets in the split train",
        captures, *mask));
    std::erase_if(fits, &SegmentFit::significant);
  }

  /// Where the data want the camera's numbers.
  std::string wanted_intrinsics() const {
    const char* const names[] = {"focal length", "principal point in x", "principal point in y"};
    std::string text;
    for (std::size_t m = 0; m < motions_.size(); ++m)
      if (const SceneMotion& motion = motions_[m]; motion.capture < 0)
        text += fmt::format("{}the {} {:+.2g} px from what the recording says (to {:.2g} px)", text.empty() ? "" : ", ",
                            names[motion.element - 6], rungs_.back().nuisances[m] * motion.sigma, motion.sigma);
    return text;
  }

  /// Parameters and intervals of a model that something was added to, from one more step.
  void take_last_step(Rung& rung) const {
    const LastStep step = last_step(experiment_, motions_, rung, rung.fit.parameters,
                                    needs_whole_series(rung.model, catalogue_), rung_options_.seed);
    rung.model = step.model;
    rung.fit.value = step.value;
    rung.fit.half_interval = student_threshold(0.05, step.freedom) * step.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }

  void report() {
    Rung& last = rungs_.back();
    const auto ladder = scores(experiment_.layout(), last, measured_.all, rungs_);
    if (!diagnosis_.candidates.empty()) take_last_step(last);
    for (std::size_t k = 0; k < rungs_.size(); ++k)
      diagnosis_.ladder.push_back({static_cast<int>(k), added_[k], removed_[k], rungs_[k].model, ladder[k]});
    diagnosis_.present = present_parameters(given_, last, catalogue_);
    diagnosis_.improved = last.model;
    write_intervals(diagnosis_.improved, last.fit, last.dispersion, options_.provenance);
    for (CandidateReport& candidate : diagnosis_.candidates) {
      fill_parameters(candidate, diagnosis_.improved, last.fit, catalogue_);
      const auto step =
          static_cast<std::size_t>(std::find(added_.begin(), added_.end(), candidate.effect) - added_.begin());
      candidate.heldout_after = ladder[step].heldout;
      for (auto& instance : diagnosis_.improved.effects) {
        if (instance.id != candidate.id) continue;
        for (auto& [name, value] : instance.values)
          if (value.ci95) value.provenance = options_.provenance;
        instance.provenance = fmt::format(
            "added by diagnosis: held-out score {:.3g} -> {:.3g} (gain of chi-square {:.3g} "
            "on captures not fitted to); {}",
            ladder[step - 1].heldout, ladder[step].heldout, candidate.evidence, options_.provenance);
      }
    }
    for (int c = 0; c < experiment_.layout().captures; ++c)
      if (const Block* block = experiment_.layout().find(c, "bias")) diagnosis_.maps.push_back(maps_of(c, *block));
  }

  std::string capture_name(int capture) const {
    return experiment_.captures()[capture].key() + " " + experiment_.captures()[capture].name;
  }

  Diagnosis::Maps maps_of(int capture, const Block& block) const {
    Diagnosis::Maps maps;
    maps.capture = capture_name(capture);
    maps.before.create(block.rows, block.cols, CV_32F);
    maps.after.create(block.rows, block.cols, CV_32F);
    maps.valid.create(block.rows, block.cols, CV_8U);
    for (int i = 0; i < block.size; ++i) {
      const float d = measured_.all[block.offset + i], first = rungs_[0].standard.mean()[block.offset + i],
                  second = rungs_.back().standard.mean()[block.offset + i];
      const bool known = !std::isnan(d) && !std::isnan(first) && !std::isnan(second);
      maps.valid.ptr<std::uint8_t>()[i] = known ? 255 : 0;
      maps.before.ptr<float>()[i] = known ? d - first : 0;
      maps.after.ptr<float>()[i] = known ? d - second : 0;
    }
    return maps;
  }

  const Experiment& experiment_;
  const Measurement& measured_;
  const SensorModel& given_;
  const Hypotheses& all_;
  const DiagnosisOptions& options_;
  Diagnosis& diagnosis_;
  const EffectCatalogue& catalogue_;
  const std::vector<SceneMotion> motions_;
  const SearchOptions search_options_;
  RungOptions rung_options_;
  std::optional<SignatureBook> book_;
  std::vector<bool> looked_closely_;  // by hypothesis
  std::vector<Rung> rungs_;
  std::vector<std::string> added_, removed_;  // by rung
  Evidence evidence_;
};

}  // namespace

Diagnosis diagnose(const ForwardModel& forward, const Experiment::FrameReader& reader, const SensorModel& model,
                   SimulationCache& cache, const DiagnosisOptions& options) {
  const auto began = std::chrono::steady_clock::now();
  Diagnosis diagnosis;
  diagnosis.improved = model;
  const Experiment experiment(forward, model, cache);
  const Measurement measured = experiment.measure(reader, diagnosis.warnings);
  const Hypotheses all = make_hypotheses(forward, model);
  diagnosis.untested = all.untested;
  for (const auto& [id, reason] : forward.inactive(model))
    diagnosis.warnings.push_back("the model's " + id + " is not active on this recording: " + reason);
  const auto lacking = lacking_data(experiment, measured.all);
  if (lacking.empty()) {
    check_registration(experiment, measured.all, model);
    Climb(experiment, measured, model, all, options, diagnosis).run();
  }
  put_into_words(diagnosis, forward.catalogue(), lacking);
  diagnosis.simulations = experiment.simulated();
  diagnosis.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return diagnosis;
}

}  // namespace binrig
