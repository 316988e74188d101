"""Numbers of other people's packages, against which the statistics of studies are tested.

    pip install SALib==1.6.0 openturns==1.27.post1 statsmodels==0.15.0 scipy==1.17.1 numpy==2.4.6
    python peers.py          # writes sobol.csv beside itself and prints everything else

The printed numbers are in tests.rs.
"""

import pathlib

import numpy as np
import openturns as ot
import statsmodels.api as sm
from SALib.analyze import sobol as analyze
from SALib.sample import sobol as sample
from scipy import integrate, optimize, stats
from statsmodels.stats.proportion import proportion_confint

here = pathlib.Path(__file__).parent


def ishigami():
    """Ishigami function, a = 7, b = 0.1 [Ishigami 1990]: SALib's estimates from 64 base points of six columns."""
    problem = {"num_vars": 3, "names": ["x1", "x2", "x3"], "bounds": [[0, 1]] * 3}
    points = sample.sample(problem, 64, calc_second_order=False, scramble=True, seed=11)
    x = np.pi * (2 * points - 1)
    y = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    base = np.hstack([points[0::5], points[4::5]])
    rows = [",".join(repr(float(v)) for v in row) for row in base]
    header = f"# SALib 1.6.0, sample.sobol, 64 base points: three columns of A, three of B\n"
    (here / "sobol.csv").write_text(header + "\n".join(rows) + "\n")
    result = analyze.analyze(problem, y, calc_second_order=False, num_resamples=20000, seed=1)
    print("Ishigami, 64 base points")
    print("  S1", [float(v) for v in result["S1"]], "ST", [float(v) for v in result["ST"]])
    z = stats.norm.ppf(0.975)
    print("  standard errors S1", result["S1_conf"] / z, "ST", result["ST_conf"] / z)


def wilson():
    for k, n in [(0, 10), (1, 10), (7, 20), (312, 10000), (10, 10)]:
        print("Wilson", k, n, [float(v) for v in proportion_confint(k, n, 0.05, "wilson")],
              [float(v) for v in proportion_confint(k, n, 0.01, "wilson")])


def fragility():
    """Lognormal fragility = probit regression on ln x; statsmodels' GLM, binomial with probit link."""
    x = np.array([0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0])
    n = np.array([40, 40, 40, 40, 40, 40, 40, 40])
    k = np.array([0, 1, 4, 9, 20, 28, 35, 38])
    fit = sm.GLM(np.column_stack([k, n - k]), sm.add_constant(np.log(x)),
                 family=sm.families.Binomial(sm.families.links.Probit())).fit(tol=1e-14)
    (a, b), c = fit.params, fit.cov_params()
    theta, beta = np.exp(-a / b), 1 / b
    # (ln theta, beta) from (a, b): d ln theta = -da/b + a db/b^2, d beta = -db/b^2
    jacobian = np.array([[-1 / b, a / b**2], [0, -1 / b**2]])
    print("fragility a, b", float(a), float(b), "theta, beta", float(theta), float(beta), "log-likelihood", fit.llf)
    print("  covariance of (ln theta, beta)", (jacobian @ c @ jacobian.T).tolist(), "deviance", float(fit.deviance))
    row = fit.get_prediction([[1.0, np.log(1.1)]]).summary_frame()
    eta = np.array([1.0, np.log(1.1)])
    centre, half = float(eta @ fit.params), float(stats.norm.ppf(0.975) * np.sqrt(eta @ c @ eta))
    print("  at 1.1:", stats.norm.cdf(centre), stats.norm.cdf(centre - half), stats.norm.cdf(centre + half), row.values.tolist())


def subset(name, function, distribution, exact):
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(distribution)), ot.Less(), 0.0)
    found, claimed = [], []
    for seed in range(200):
        ot.RandomGenerator.SetSeed(seed)
        algorithm = ot.SubsetSampling(event)
        algorithm.setMaximumOuterSampling(1000)
        algorithm.setBlockSize(1)
        algorithm.setConditionalProbability(0.1)
        algorithm.run()
        result = algorithm.getResult()
        found.append(result.getProbabilityEstimate())
        claimed.append(result.getCoefficientOfVariation())
    found = np.array(found)
    print(f"{name}: exact {exact:.10e}; OpenTURNS, 200 runs of 1000 a level: mean {found.mean():.6e}, scatter "
          f"{found.std(ddof=1) / found.mean():.4f}, mean claimed c.o.v. {np.mean(claimed):.4f}")


def beam():
    """Axially stressed beam of OpenTURNS' documentation: R - F/(pi 100), R lognormal (300, 30), F normal (75 000, 5000)."""
    r = ot.LogNormalMuSigma(300.0, 30.0, 0.0).getDistribution()
    f = ot.Normal(75e3, 5e3)
    sigma = np.sqrt(np.log(1 + 0.01))
    mu = np.log(300) - sigma**2 / 2
    exact = integrate.quad(lambda v: stats.norm.pdf(v) * stats.norm.cdf((np.log((75e3 + 5e3 * v) / (np.pi * 100)) - mu) / sigma),
                           -8, 8, epsabs=1e-14)[0]
    subset("beam", ot.SymbolicFunction(["R", "F"], ["R-F/(pi_*100.0)"]), ot.JointDistribution([r, f]), exact)


def cubic():
    """Limit state of OpenTURNS' example of subset sampling: 20 - (x1 - x2)^2 - 8 (x1 + x2 - 4)^3, both normal (0.25, 1)."""
    # s = x1 + x2 ~ N(0.5, sqrt 2), d = x1 - x2 ~ N(0, sqrt 2), independent.
    def given_d(d):
        s = 4 + np.cbrt((20 - d**2) / 8)
        return stats.norm.pdf(d, 0, np.sqrt(2)) * stats.norm.sf(s, 0.5, np.sqrt(2))
    exact = integrate.quad(given_d, -15, 15, epsabs=1e-16, points=[-np.sqrt(20), np.sqrt(20)], limit=400)[0]
    subset("cubic", ot.SymbolicFunction(["x1", "x2"], ["20-(x1-x2)^2-8*(x1+x2-4)^3"]), ot.Normal([0.25] * 2, [1.0] * 2, ot.CorrelationMatrix(2)), exact)


def four_branches():
    """Series system with four branches [Waarts 2000], standard normal."""
    g = ["min(min(3+0.1*(x1-x2)^2-(x1+x2)/sqrt(2), 3+0.1*(x1-x2)^2+(x1+x2)/sqrt(2)), min((x1-x2)+7/sqrt(2), (x2-x1)+7/sqrt(2)))"]
    # With s, d = (x1 +- x2)/sqrt 2 independent standard normal: fails unless |d| < 3.5 and |s| < 3 + 0.2 d^2.
    inside = integrate.quad(lambda d: stats.norm.pdf(d) * (2 * stats.norm.cdf(3 + 0.2 * d * d) - 1), -3.5, 3.5, epsabs=1e-14)[0]
    subset("four branches", ot.SymbolicFunction(["x1", "x2"], g), ot.Normal(2), 1 - inside)


ishigami()
wilson()
fragility()
beam()
cubic()
four_branches()
