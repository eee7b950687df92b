"""What a methods section cites: references by key, with their DOIs. docs/methods.md has the same list."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """A publication; ``doi`` is empty for one that has none."""

    text: str
    doi: str = ""

    def line(self) -> str:
        """As a list of references shows it."""
        return f"{self.text} https://doi.org/{self.doi}" if self.doi else self.text


REFERENCES: Mapping[str, Reference] = {
    "pekedis": Reference(
        "Pekedis M. In-vitro measurements coupled with in-silico simulations for stochastic calibration and "
        "uncertainty "
        "quantification of the mechanical response of biological materials. arXiv:2503.09900 (2025).",
        "10.48550/arXiv.2503.09900",
    ),
    "febio": Reference(
        "Maas S., Ellis B., Ateshian G., Weiss J. FEBio: finite elements for biomechanics. J Biomech Eng 134 (2012).",
        "10.1115/1.4005694",
    ),
    "puso": Reference(
        "Puso M., Weiss J. Finite element implementation of anisotropic quasi-linear viscoelasticity using a discrete "
        "spectrum approximation. J Biomech Eng 120 (1998).",
        "10.1115/1.2834308",
    ),
    "saltelli": Reference(
        "Saltelli A. et al. Variance based sensitivity analysis of model output. Comput Phys Commun 181 (2010).",
        "10.1016/j.cpc.2009.09.018",
    ),
    "salib": Reference(
        "Herman J., Usher W. SALib: an open-source Python library for sensitivity analysis. JOSS 2 (2017).",
        "10.21105/joss.00097",
    ),
    "kucherenko": Reference(
        "Kucherenko S., Tarantola S., Annoni P. Estimation of global sensitivity indices for models with dependent "
        "variables. Comput Phys Commun 183 (2012).",
        "10.1016/j.cpc.2011.12.020",
    ),
    "owen": Reference(
        "Owen A. Sobol' indices and Shapley value. SIAM/ASA J Uncertain Quantif 2 (2014).", "10.1137/130936233"
    ),
    "goda": Reference(
        "Goda T. A simple algorithm for global sensitivity analysis with Shapley effects. Reliab Eng Syst Saf 213 "
        "(2021) 107702.",
        "10.1016/j.ress.2021.107702",
    ),
    "breiman": Reference("Breiman L. Random forests. Mach Learn 45 (2001).", "10.1023/A:1010933404324"),
    "marquardt": Reference(
        "Marquardt D. An algorithm for least-squares estimation of nonlinear parameters. J SIAM 11 (1963).",
        "10.1137/0111030",
    ),
    "patterson": Reference(
        "Patterson H., Thompson R. Recovery of inter-block information when block sizes are unequal. Biometrika 58 "
        "(1971).",
        "10.1093/biomet/58.3.545",
    ),
    "jones": Reference(
        "Jones D., Schonlau M., Welch W. Efficient global optimization of expensive black-box functions. J Glob "
        "Optim 13 "
        "(1998).",
        "10.1023/A:1008306431147",
    ),
    "astudillo": Reference("Astudillo R., Frazier P. Bayesian optimization of composite functions. Proc ICML (2019)."),
    "bakdash": Reference(
        "Bakdash J., Marusich L. Repeated measures correlation. Front Psychol 8 (2017).", "10.3389/fpsyg.2017.00456"
    ),
    "pyabc": Reference(
        "Schaelte Y. et al. pyABC: efficient and robust easy-to-use approximate Bayesian computation. JOSS 7 (2022).",
        "10.21105/joss.04304",
    ),
    "hesterberg": Reference(
        "Hesterberg T. Weighted average importance sampling and defensive mixture distributions. Technometrics 37 "
        "(1995).",
        "10.1080/00401706.1995.10484303",
    ),
    "kennedy": Reference(
        "Kennedy M., O'Hagan A. Bayesian calibration of computer models. J R Stat Soc B 63 (2001).",
        "10.1111/1467-9868.00294",
    ),
    "huang": Reference(
        "Huang A., Wand M. Simple marginally noninformative prior distributions for covariance matrices. Bayesian "
        "Analysis 8 (2013).",
        "10.1214/13-BA815",
    ),
    "liu": Reference(
        "Liu J. Monte Carlo strategies in scientific computing. Springer (2001).", "10.1007/978-0-387-76371-2"
    ),
    "vihola": Reference(
        "Vihola M., Helske J., Franks J. Importance sampling type estimators based on approximate marginal Markov "
        "chain Monte Carlo. Scand J Stat 47 (2020).",
        "10.1111/sjos.12492",
    ),
    "sudret": Reference(
        "Sudret B. Global sensitivity analysis using polynomial chaos expansions. Reliab Eng Syst Saf 93 (2008).",
        "10.1016/j.ress.2007.04.002",
    ),
    "blatman": Reference(
        "Blatman G., Sudret B. Adaptive sparse polynomial chaos expansion based on least angle regression. J Comput "
        "Phys 230 (2011).",
        "10.1016/j.jcp.2010.12.021",
    ),
    "fidelities": Reference(
        "Kennedy M., O'Hagan A. Predicting the output from a complex computer code when fast approximations are "
        "available. Biometrika 87 (2000).",
        "10.1093/biomet/87.1.1",
    ),
    "vehtari": Reference(
        "Vehtari A., Gelman A., Simpson D., Carpenter B., Bürkner P. Rank-normalization, folding, and localization: an "
        "improved R-hat for assessing convergence of MCMC. Bayesian Analysis 16 (2021).",
        "10.1214/20-BA1221",
    ),
    "delong": Reference(
        "DeLong E., DeLong D., Clarke-Pearson D. Comparing the areas under two or more correlated ROC curves. "
        "Biometrics 44 (1988).",
        "10.2307/2531595",
    ),
    "cohn": Reference(
        "Cohn D. Neural network exploration using optimal experiment design. Neural Networks 9 (1996).",
        "10.1016/0893-6080(95)00137-9",
    ),
    "morris": Reference(
        "Morris M. Factorial sampling plans for preliminary computational experiments. Technometrics 33 (1991).",
        "10.1080/00401706.1991.10484804",
    ),
    "campolongo": Reference(
        "Campolongo F., Cariboni J., Saltelli A. An effective screening design for sensitivity analysis of "
        "large models. "
        "Environ Model Softw 22 (2007).",
        "10.1016/j.envsoft.2006.10.004",
    ),
    "pianosi": Reference(
        "Pianosi F., Wagener T. Distribution-based sensitivity analysis from a generic input-output sample. "
        "Environ Model "
        "Softw 108 (2018).",
        "10.1016/j.envsoft.2018.07.019",
    ),
}
